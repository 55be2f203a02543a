# SPDX-License-Identifier: Apache-2.0
"""The functions of gsplat's module of this name. Other names of gsplat are refused when they are called (absent.py).
PyTorch computes them, so tensors may also be float64.

Sums of products are not written as matrix products, which would lose precision in torch.autocast."""

from __future__ import annotations

import math
from typing import Any, Optional, get_args

import torch
from torch import Tensor

from ..absent import refusing
from ..checks import check_choice, check_tensor, shape_of, whole_number
from ..rendering import (
    CameraModel,
    RollingShutterType,
    _axes,
    _intrinsics,
    _Projected,
    fully_fused_projection,
    spherical_harmonics,
)
from ..tiles import isect_offset_encode, isect_tiles

__all__ = [
    "RollingShutterType",
    "fully_fused_projection",
    "isect_offset_encode",
    "isect_tiles",
    "proj",
    "quat_scale_to_covar_preci",
    "spherical_harmonics",
    "world_to_cam",
]


def quat_scale_to_covar_preci(
    quats: Tensor, scales: Tensor, compute_covar: bool = True, compute_preci: bool = True, triu: bool = False
) -> tuple[Optional[Tensor], Optional[Tensor]]:
    """Returns the covariance matrices (..., 3, 3) of Gaussians, and their inverses, which are the precision matrices.
    quats (..., 4) begin with w, and may have any length but 0. scales are (..., 3). With `triu`, the results are the
    upper triangles (..., 6). A result that is not requested is None."""
    shape = shape_of("quats", quats, 1)[:-1]
    check_tensor("quats", quats, (*shape, 4), double=True)
    check_tensor("scales", scales, (*shape, 3), like=quats, double=True)

    def squared(axes: Tensor) -> Tensor:
        matrix = (axes[:, None] * axes[None]).sum(2)
        rows = matrix[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]] if triu else matrix.flatten(0, 1)
        return rows.movedim(0, -1) if triu else rows.movedim(0, -1).unflatten(-1, (3, 3))

    return (
        squared(_axes(quats, scales)) if compute_covar else None,
        squared(_axes(quats, 1 / scales)) if compute_preci else None,
    )


def world_to_cam(means: Tensor, covars: Tensor, viewmats: Tensor) -> tuple[Tensor, Tensor]:
    """Converts Gaussians to the coordinate systems of C cameras. means (..., N, 3), covars (..., N, 3, 3) and viewmats
    (..., C, 4, 4), from world to camera. Returns means (..., C, N, 3) and covars (..., C, N, 3, 3)."""
    *batch, n, _ = shape_of("means", means, 2)
    cameras = shape_of("viewmats", viewmats, 3)[-3]
    check_tensor("means", means, (*batch, n, 3), double=True)
    check_tensor("covars", covars, (*batch, n, 3, 3), like=means, double=True)
    check_tensor("viewmats", viewmats, (*batch, cameras, 4, 4), like=means, double=True)
    rotations, shifts = viewmats[..., None, :3, :3], viewmats[..., None, :3, 3]
    points = (rotations * means[..., None, :, None, :]).sum(-1) + shifts
    turned = (rotations[..., None] * covars[..., None, :, None, :, :]).sum(-2)
    return points, (turned[..., :, None, :] * rotations[..., None, :, :]).sum(-1)


def proj(
    means: Tensor, covars: Tensor, Ks: Tensor, width: int, height: int, camera_model: str = "pinhole"
) -> tuple[Tensor, Tensor]:
    """Projects Gaussians in the coordinate systems of C cameras, as world_to_cam() returns them. means (..., C, N, 3),
    covars (..., C, N, 3, 3) and Ks (..., C, 3, 3). Returns means (..., C, N, 2) in pixels and covars (..., C, N, 2, 2)
    in square pixels, without blur. The results of Gaussians behind a camera have no meaning."""
    check_choice("camera_model", camera_model, get_args(CameraModel))
    *batch, n, _ = shape_of("means", means, 3)
    check_tensor("means", means, (*batch, n, 3), double=True)
    check_tensor("covars", covars, (*batch, n, 3, 3), like=means, double=True)
    check_tensor("Ks", Ks, (*batch, 3, 3), like=means, double=True)
    _intrinsics(Ks)
    count, size = math.prod(batch), (whole_number("width", width), whole_number("height", height))
    covars = (covars + covars.transpose(-1, -2)) / 2  # so that the gradients are symmetric matrices
    seen = _Projected(  # each image is a batch of its own, whose only camera is at the origin
        means.reshape(count, n, 3), None, covars.reshape(count, n, 3, 3).permute(2, 3, 0, 1),
        torch.eye(4).to(means).expand(count, 1, 4, 4), Ks.reshape(count, 1, 3, 3), size, camera_model,
        (0.0, math.inf), eps2d=0.0,
    )
    covars2d = torch.stack([seen.a, seen.b, seen.b, seen.c], -1)
    return seen.means2d.permute(1, 2, 3, 0).reshape(*batch, n, 2), covars2d.reshape(*batch, n, 2, 2)


def __getattr__(name: str) -> Any:
    return refusing(__name__, name)
