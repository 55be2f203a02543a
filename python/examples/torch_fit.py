# SPDX-License-Identifier: Apache-2.0
"""Trains a model with PyTorch's Adam and a custom loss: python torch_fit.py DATA MODEL.ply [STEPS].

The command `ubs synth glossy --out DATA` creates the data. This example shows how to use ubs.torch. For real trainings,
use ubs.train(), which is faster and can add splats."""

from __future__ import annotations

import sys

import torch

import ubs
import ubs.torch

# Learning rates. All parameters that are not listed have a learning rate of 1e-3.
RATES = {"xyz": 2e-4, "rgb": 5e-3, "opacity": 5e-2, "scale": 5e-3}


def charbonnier(image: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    """Returns the Charbonnier loss, which is a smooth variant of the mean absolute difference."""
    loss: torch.Tensor = torch.sqrt((image - target) ** 2 + 1e-6).mean()
    return loss


def psnr(splats: ubs.torch.Splats, views: list[ubs.View]) -> float:
    model = splats.model()
    return sum(ubs.metrics.psnr(view.image, model.render(view.camera)) for view in views) / len(views)


def fit(data: ubs.Dataset, steps: int) -> tuple[ubs.torch.Splats, list[float]]:
    torch.manual_seed(0)
    splats = ubs.torch.Splats(ubs.Model.initial(data, dim=6, init_points=2000))
    groups = [{"params": [p], "lr": RATES.get(name, 1e-3)} for name, p in splats.named_parameters()]
    adam = torch.optim.Adam(groups, eps=1e-15)
    targets: list[torch.Tensor] = [torch.from_numpy(view.image).float().div(255) for view in data.train]
    losses = []
    for step in range(steps):
        view = int(torch.randint(len(targets), ()))
        rgb, alpha = splats(data.train[view].camera)
        loss = charbonnier(rgb, targets[view]) + 1e-3 * alpha.mean()  # may be any function of rgb and alpha
        adam.zero_grad()
        loss.backward()
        adam.step()
        losses.append(float(loss))
        if step % 50 == 0:
            print(f"step {step}: loss {losses[-1]:.4f}")
    return splats, losses


def main(arguments: list[str]) -> None:
    data = ubs.Dataset.open(arguments[0])
    splats, _ = fit(data, int(arguments[2]) if len(arguments) > 2 else 300)
    print(f"PSNR of the test views: {psnr(splats, data.test):.2f} dB")
    splats.model().save(arguments[1])


if __name__ == "__main__":
    main(sys.argv[1:])
