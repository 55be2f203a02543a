# SPDX-License-Identifier: Apache-2.0
"""Fits Gaussians to one image: python image_fit.py IMAGE OUT.png [GAUSSIANS [STEPS]]. Needs PyTorch and Pillow.

There is only one camera, so the Gaussians learn its image, but not the geometry of a scene. This is a small example of
rasterization() with an optimiser. The same code runs with gsplat on CUDA if rasterization() is imported from gsplat
instead of ubs.gsplat."""

from __future__ import annotations

import sys

import numpy as np
import torch

from ubs.gsplat import rasterization

RATES = {"means": 0.01, "scales": 0.02, "quats": 0.01, "opacities": 0.05, "colors": 0.02}


def start(count: int) -> dict[str, torch.Tensor]:
    """Returns random Gaussians in a box that is visible from the camera of render()."""
    return {
        "means": torch.rand(count, 3) * torch.tensor([2.0, 2.0, 1.0]) - torch.tensor([1.0, 1.0, 0.5]),
        "scales": torch.full((count, 3), 0.5 / count**0.5).log(),
        "quats": torch.randn(count, 4),
        "opacities": torch.zeros(count),
        "colors": torch.zeros(count, 3),
    }


def render(values: dict[str, torch.Tensor], width: int, height: int) -> torch.Tensor:
    """Returns the image (height, width, 3) of a camera that has a distance of 2 to the origin and looks at it. In the
    plane z = 0, the camera sees x and y from -1 to 1."""
    viewmat = torch.eye(4)
    viewmat[2, 3] = 2.0
    k = torch.tensor([[1.0 * width, 0, width / 2], [0, 1.0 * height, height / 2], [0, 0, 1]])
    images, _, _ = rasterization(
        values["means"], values["quats"], values["scales"].exp(), values["opacities"].sigmoid(),
        values["colors"].sigmoid(), viewmat[None], k[None], width, height,
    )
    image: torch.Tensor = images[0]
    return image


def fit(target: torch.Tensor, count: int, steps: int) -> tuple[torch.Tensor, list[float]]:
    """Fits `count` Gaussians to an image (height, width, 3) with values from 0 to 1. Returns the image of the fitted
    Gaussians, and the mean squared error before each step."""
    height, width, _ = target.shape
    values = {name: value.requires_grad_() for name, value in start(count).items()}
    adam = torch.optim.Adam([{"params": [values[name]], "lr": rate} for name, rate in RATES.items()])
    errors = []
    for step in range(steps):
        error = ((render(values, width, height) - target) ** 2).mean()
        adam.zero_grad()
        error.backward()
        adam.step()
        errors.append(float(error))
        if step % 100 == 0:
            print(f"step {step}: PSNR {-10 * np.log10(errors[-1]):.2f} dB")
    with torch.no_grad():
        return render(values, width, height), errors


def main(arguments: list[str]) -> None:
    from PIL import Image

    with Image.open(arguments[0]) as file:
        target = torch.from_numpy(np.array(file.convert("RGB"))).float() / 255
    numbers = [int(text) for text in arguments[2:]] + [2000, 1000][len(arguments) - 2 :]
    image, errors = fit(target, *numbers)
    print(f"PSNR {-10 * np.log10(errors[-1]):.2f} dB with {numbers[0]} Gaussians")
    Image.fromarray((image.clamp(0, 1) * 255).round().byte().numpy()).save(arguments[1])


if __name__ == "__main__":
    main(sys.argv[1:])
