# SPDX-License-Identifier: Apache-2.0
"""Trains Gaussians with the functions and strategies of gsplat on any device of ubs:

    python gsplat_train.py --strategy mcmc [DATA]

DATA is a folder of any layout that ubs reads. Without DATA, the example creates a synthetic scene. The same training
loop runs with gsplat on CUDA if the import of ubs.gsplat below is replaced by an import of gsplat."""

from __future__ import annotations

import argparse
from typing import Any, Optional

import torch
from torch import Tensor

import ubs
from ubs.gsplat import DefaultStrategy, MCMCStrategy, rasterization

# Learning rates. That of the means is multiplied by the size of the scene, and falls to a hundredth of this value.
RATES = {"means": 1.6e-4, "scales": 5e-3, "quats": 1e-3, "opacities": 5e-2, "sh0": 2.5e-3, "shN": 1.25e-4}


def start(points: Tensor) -> dict[str, torch.nn.Parameter]:
    """Returns the parameters of grey Gaussians at these points (n, 3). The scale of each Gaussian is the root mean
    square of the distances to its three nearest neighbours."""
    nearest = [torch.cdist(part, points).topk(min(4, len(points)), largest=False)[0] for part in points.split(1024)]
    size, n = torch.cat(nearest)[:, 1:].square().mean(-1).sqrt().clamp_min(1e-7), len(points)
    values = {
        "means": points, "scales": size.log()[:, None].repeat(1, 3), "quats": torch.randn(n, 4),
        "opacities": torch.full((n,), 0.3).logit(), "sh0": torch.zeros(n, 1, 3), "shN": torch.zeros(n, 15, 3),
    }
    return {name: torch.nn.Parameter(value) for name, value in values.items()}


def render(params: dict[str, Any], camera: ubs.Camera, degree: int = 3) -> tuple[Tensor, dict[str, Any]]:
    """Returns the image (H, W, 3) that a camera sees, and the dictionary that the strategies need."""
    viewmat = torch.eye(4)
    viewmat[:3] = torch.from_numpy(camera.world_to_camera)
    k = torch.tensor([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    colors = torch.cat([params["sh0"], params["shN"]], 1)
    images, _, info = rasterization(
        params["means"], params["quats"], params["scales"].exp(), params["opacities"].sigmoid(), colors,
        viewmat[None], k[None], camera.width, camera.height, sh_degree=degree, packed=False,
    )
    return images[0], info


def ssim(a: Tensor, b: Tensor) -> Tensor:
    """Returns the structural similarity of two images (H, W, 3), with Gaussian windows of 11 x 11 pixels."""
    weights = torch.exp(-((torch.arange(11) - 5) ** 2) / (2 * 1.5**2))
    window = (weights[:, None] * weights / weights.sum() ** 2).expand(15, 1, 11, 11)
    stacked = torch.cat([a, b, a * a, b * b, a * b], -1).permute(2, 0, 1)[None]
    mean_a, mean_b, aa, bb, ab = torch.nn.functional.conv2d(stacked, window, padding=5, groups=15)[0].split(3)
    c1, c2 = 0.01**2, 0.03**2
    alike = (2 * mean_a * mean_b + c1) * (2 * (ab - mean_a * mean_b) + c2)
    return torch.mean(alike / ((mean_a**2 + mean_b**2 + c1) * (aa - mean_a**2 + bb - mean_b**2 + c2)))


def train(data: ubs.Dataset, strategy: str, steps: int, gaussians: int, most: int) -> dict[str, Any]:
    """Returns the trained parameters. The initial number of Gaussians is the number of points of the data, or
    `gaussians` if the data have no points. With "mcmc", the number grows to at most `most`."""
    torch.manual_seed(0)
    views = [(view.camera, torch.from_numpy(view.image).float() / 255) for view in data.train]
    poses = torch.stack([torch.from_numpy(camera.world_to_camera) for camera, _ in views])
    centres = -(poses[:, :, :3].mT @ poses[:, :, 3:])[..., 0]
    extent = 1.1 * float((centres - centres.mean(0)).norm(dim=-1).max())  # size of the scene
    points = ubs.Model.initial(data, dim=3, init_points=gaussians, unit=1).parameters["xyz"]
    params = start(torch.from_numpy(points.copy()))
    rates = {**RATES, "means": RATES["means"] * extent}
    optimizers = {name: torch.optim.Adam([params[name]], lr=rate, eps=1e-15) for name, rate in rates.items()}
    falling = torch.optim.lr_scheduler.ExponentialLR(optimizers["means"], 0.01 ** (1 / steps))
    refine: dict[str, Any] = {"refine_start_iter": steps // 20, "refine_every": max(1, min(100, steps // 30))}
    if strategy == "mcmc":
        chosen: Any = MCMCStrategy(cap_max=most, refine_stop_iter=steps * 5 // 6, **refine)
        state = chosen.initialize_state()
    else:
        chosen = DefaultStrategy(refine_stop_iter=steps // 2, reset_every=steps // 5, **refine)
        state = chosen.initialize_state(scene_scale=extent)
    chosen.check_sanity(params, optimizers)
    for step in range(steps):
        camera, target = views[int(torch.randint(len(views), ()))]
        image, info = render(params, camera, degree=min(3, step * 10 // steps))
        loss = 0.8 * (image - target).abs().mean() + 0.2 * (1 - ssim(image, target))
        if strategy == "mcmc":
            # MCMC relocates transparent Gaussians. Without these penalties, only few Gaussians become transparent.
            loss = loss + 0.01 * params["opacities"].sigmoid().mean() + 0.01 * params["scales"].exp().mean()
        chosen.step_pre_backward(params, optimizers, state, step, info)
        loss.backward()
        for optimizer in optimizers.values():
            optimizer.step()
            optimizer.zero_grad(set_to_none=True)
        falling.step()
        rest = {"lr": falling.get_last_lr()[0]} if strategy == "mcmc" else {"packed": False}
        chosen.step_post_backward(params, optimizers, state, step, info, **rest)
        if step % 100 == 0:
            print(f"step {step}: loss {float(loss.detach()):.4f}, {len(params['means'])} Gaussians")
    return params


def main(arguments: Optional[list[str]] = None) -> None:
    parser = argparse.ArgumentParser(description="Trains Gaussians with ubs.gsplat.")
    add = parser.add_argument
    add("data", nargs="?", help="folder of images and cameras; without it, a synthetic scene is used")
    add("--strategy", choices=("default", "mcmc"), default="default",
        help="adds and removes Gaussians as in 3D Gaussian Splatting (default) or 3DGS-MCMC (mcmc) [default]")
    add("--steps", type=int, default=2000, help="number of training steps [2000]")
    add("--gaussians", type=int, default=2000, help="initial number of Gaussians if the data have no points [2000]")
    add("--cap-max", type=int, default=10000, help="maximum number of Gaussians with --strategy mcmc [10000]")
    given = parser.parse_args(arguments)
    data = ubs.Dataset.open(given.data) if given.data else ubs.synth("glossy")
    params = train(data, given.strategy, given.steps, given.gaussians, given.cap_max)
    test = data.test or data.train
    with torch.no_grad():
        values = [ubs.metrics.psnr(render(params, view.camera)[0].numpy(), view.image) for view in test]
    print(f"PSNR {sum(values) / len(values):.2f} dB over {len(test)} views with {len(params['means'])} Gaussians")


if __name__ == "__main__":
    main()
