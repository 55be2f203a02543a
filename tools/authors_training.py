#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs train.py of the authors of Universal Beta Splatting on any device. Functions of this project replace the
authors' CUDA kernels: ubs.torch.condition() computes the splats for a query, ubs.gsplat.fully_fused_projection()
projects them, and ubs.torch.rasterize() renders them.

    tools/authors_training.py CHECKOUT --source_path DATA --model_path OUT --iterations 1000 --input_dim 6 --eval
    ubs eval OUT/point_cloud/iteration_1000/point_cloud.ply DATA

CHECKOUT is a clone of github.com/RongLiu-Leo/universal-beta-splatting; this project contains no part of it. The
other arguments are those of train.py. The final evaluation of train.py is not run; use `ubs eval` instead. This
program needs scikit-learn, plyfile, imagesize, scipy and tqdm, but not fused_ssim, viser, nerfview, lpips, torchvision
and CUDA. UBS_DEVICE selects the device that renders."""

from __future__ import annotations

import pathlib
import runpy
import shutil
import sys
import tempfile
import types
from typing import Any

import torch
import ubs.torch
from ubs.gsplat import fully_fused_projection

Tensor = torch.Tensor


def cond_mean_convariance_opacity(
    means: Tensor, covars: Tensor, opacities: Tensor, betas: Tensor, query: Tensor
) -> tuple[Tensor, ...]:
    factor = torch.linalg.cholesky(covars)
    # The authors' function has no gradient with respect to the query.
    positions, covariances, change = ubs.torch.condition(means, factor, betas, query.detach())
    return positions, covariances, opacities * change[:, None]


def rasterization(
    *, means: Tensor, covars: Tensor, opacities: Tensor, betas: Tensor, colors: Tensor, viewmats: Tensor, Ks: Tensor,
    width: int, height: int, backgrounds: Tensor, **_: Any,
) -> tuple[Tensor, Tensor, dict[str, Tensor]]:
    radii, means2d, depths, conics, _ = fully_fused_projection(
        means, covars[:, (0, 0, 0, 1, 1, 2), (0, 1, 2, 1, 2, 2)], None, None, viewmats, Ks, width, height
    )
    seen = (radii > 0).all(-1)[0]
    xx, xy, yy = conics[0, seen].unbind(-1)
    covs2d = torch.stack([yy, -xy, -xy, xx], -1).reshape(-1, 2, 2) / (xx * yy - xy * xy)[:, None, None]
    image, alpha = ubs.torch.rasterize(
        means2d[0, seen], covs2d, depths[0, seen], colors[seen], opacities[seen], betas[seen],
        width=width, height=height, background=backgrounds[0],
    )
    return image[None], alpha[None, ..., None], {"means2d": means2d, "radii": radii}


def ssim(a: Tensor, b: Tensor) -> Tensor:
    """Returns the SSIM of two images, with 11 x 11 Gaussian windows and zeros around the images."""
    line = torch.exp(-((torch.arange(11.0) - 5) ** 2) / 4.5)
    line = (line / line.sum()).to(a)

    def blurred(x: Tensor) -> Tensor:
        kernel = line.expand(x.shape[1], 1, 1, 11)
        x = torch.nn.functional.conv2d(x, kernel, padding=(0, 5), groups=x.shape[1])
        return torch.nn.functional.conv2d(x, kernel.mT, padding=(5, 0), groups=x.shape[1])

    p, q = blurred(a), blurred(b)
    variances = blurred(a * a) - p * p, blurred(b * b) - q * q
    mean, spread = (2 * p * q + 1e-4) / (p * p + q * q + 1e-4), (2 * (blurred(a * b) - p * q) + 9e-4)
    return (mean * spread / (variances[0] + variances[1] + 9e-4)).mean()


class Anything:
    """Replaces classes that are imported but not needed: those of the viewer, and those that only measure times on
    CUDA."""

    def __init__(self, *_: Any, **__: Any) -> None:
        pass

    def record(self) -> None:
        pass


def provide(name: str, **members: Any) -> None:
    module = types.ModuleType(name)
    module.__dict__.update(members)
    sys.modules[name] = module


def main() -> None:
    if len(sys.argv) < 2 or not (pathlib.Path(sys.argv[1]) / "scene/beta_model.py").is_file():
        sys.exit(f"usage: {sys.argv[0]} CHECKOUT [arguments of its train.py]; see the text at the top of this file")
    with tempfile.TemporaryDirectory() as folder:
        place = pathlib.Path(folder) / "code"
        shutil.copytree(sys.argv[1], place, ignore=shutil.ignore_patterns("submodules", ".git"))
        for file in place.rglob("*.py"):
            text = file.read_text()
            # int32 is replaced too, because older versions of PyTorch only accept int64 as indices.
            for old, new in ((".cuda()", ""), ('"cuda:0"', '"cpu"'), ('"cuda"', '"cpu"'), ("torch.int32", "torch.int64")):
                text = text.replace(old, new)
            if file.name == "train.py":
                text = text.replace("if args.eval:", "if False:")  # the evaluation needs LPIPS and 30 000 iterations
            file.write_text(text)
        reference = str(pathlib.Path(sys.argv[1]) / "submodules/gsplat/cuda/_torch_impl.py")
        torch_code = runpy.run_path(reference)
        functions = {
            "l_triangle_to_rotmat": torch_code["_l_triangle_to_rotmat"],
            "rot_scale_l_triangle_to_covar": torch_code["_rot_scale_l_triangle_to_covar"],
            "cond_mean_convariance_opacity": cond_mean_convariance_opacity,
        }
        for name in ("gsplat", "gsplat.cuda"):
            provide(name)
        provide("gsplat.rendering", rasterization=rasterization)
        provide("gsplat.cuda._torch_impl", **{f"_{name}": function for name, function in functions.items()})
        provide("gsplat.cuda._wrapper", **functions)
        provide("fused_ssim", fused_ssim=ssim)
        provide("viser", ViserServer=Anything)
        provide("nerfview", Viewer=Anything, RenderTabState=Anything)
        provide("torchvision", datasets=None)
        provide("torchvision.utils", save_image=None)
        provide("lpipsPyTorch", lpips=lambda *_, **__: torch.zeros(()))
        torch.cuda.Event = Anything  # type: ignore[assignment, misc]
        torch.cuda.set_device = lambda *_: None  # type: ignore[assignment]
        sys.path.insert(0, str(place))
        sys.argv = [str(place / "train.py"), *sys.argv[2:], "--disable_viewer"]
        runpy.run_path(sys.argv[0], run_name="__main__")


if __name__ == "__main__":
    main()
