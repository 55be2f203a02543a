# SPDX-License-Identifier: Apache-2.0
"""Functions that trainers use in addition to the rasteriser."""

from __future__ import annotations

import math
import os
from typing import Any, Mapping, Optional

import torch
from torch import Tensor

from .._errors import UsageError
from .exporter import SH0, export_splats
from .rendering import _columns


def save_ply(splats: Mapping[str, Tensor], dir: "str | os.PathLike[str]", colors: Optional[Tensor] = None) -> None:
    """Saves the parameters "means", "scales", "quats", "opacities", "sh0" and "shN" as a PLY file with the path `dir`.
    With `colors` (N, 3), which are from 0 to 1, saves these instead of the harmonics. See export_splats()."""
    values = {name: splats[name] for name in ("means", "scales", "quats", "opacities", "sh0", "shN")}
    if colors is not None:
        values.update(sh0=((colors - 0.5) / SH0)[:, None], shN=colors.new_zeros(len(colors), 0, 3))
    export_splats(**values, format="ply", save_to=dir)


def normalized_quat_to_rotmat(quat: Tensor) -> Tensor:
    """Returns the rotation matrices (..., 3, 3) of unit quaternions (..., 4), which begin with w."""
    return torch.stack(_columns(quat), 1).movedim((0, 1), (-2, -1))


def log_transform(x: Tensor) -> Tensor:
    """Returns sign(x) log(1 + |x|)."""
    return torch.sign(x) * torch.log1p(x.abs())


def inverse_log_transform(y: Tensor) -> Tensor:
    """Returns the inverse of log_transform()."""
    return torch.sign(y) * torch.expm1(y.abs())


def depth_to_points(depths: Tensor, camtoworlds: Tensor, Ks: Tensor, z_depth: bool = True) -> Tensor:
    """Returns the points (..., H, W, 3) in the world that the centres of pixels show. depths (..., H, W, 1) are
    measured along the optical axis, or with z_depth=False along the ray through the pixel. camtoworlds (..., 4, 4) are
    matrices from camera to world, and Ks are (..., 3, 3)."""
    if depths.dim() < 3 or depths.shape[-1] != 1:
        raise UsageError(f"depths has the shape {tuple(depths.shape)}, not (..., H, W, 1)")
    batch = tuple(depths.shape[:-3])
    if tuple(camtoworlds.shape) != (*batch, 4, 4) or tuple(Ks.shape) != (*batch, 3, 3):
        found = f"{tuple(camtoworlds.shape)} and {tuple(Ks.shape)}"
        raise UsageError(f"camtoworlds and Ks have the shapes {found}, not {(*batch, 4, 4)} and {(*batch, 3, 3)}")
    fx, fy, cx, cy = (Ks[..., i, j, None, None] for i, j in ((0, 0), (1, 1), (0, 2), (1, 2)))
    ys, xs = (torch.arange(size, device=depths.device) + 0.5 for size in depths.shape[-3:-1])
    x, y = torch.broadcast_tensors((xs - cx) / fx, (ys[:, None] - cy) / fy)
    rays = torch.stack([x, y, torch.ones_like(x)], -1)
    if not z_depth:
        rays = torch.nn.functional.normalize(rays, dim=-1)
    poses = camtoworlds[..., None, None, :3, :]
    return (poses[..., :3] * rays[..., None, :]).sum(-1) * depths + poses[..., 3]


def depth_to_normal(depths: Tensor, camtoworlds: Tensor, Ks: Tensor, z_depth: bool = True) -> Tensor:
    """Returns the unit normals (..., H, W, 3) in the world of the surface that depth_to_points() returns. They point to
    the side of the camera. They are computed from the neighbours of a pixel, and are 0 at the border of the image."""
    points = depth_to_points(depths, camtoworlds, Ks, z_depth)
    normals = torch.zeros_like(points)
    height, width = points.shape[-3:-1]
    if height > 2 and width > 2:
        rows, columns = points[..., 1:-1, :], points[..., 1:-1, :, :]
        vertical = rows[..., 2:, :, :] - rows[..., :-2, :, :]
        horizontal = columns[..., 2:, :] - columns[..., :-2, :]
        across = torch.linalg.cross(vertical, horizontal)
        normals[..., 1:-1, 1:-1, :] = torch.nn.functional.normalize(across, dim=-1)
    return normals


def get_projection_matrix(znear: float, zfar: float, fovX: float, fovY: float, device: Any = "cpu") -> Tensor:
    """Returns the matrix (4, 4) that projects homogeneous points of a camera whose axis z points forward. The visible
    x / w and y / w are from -1 to 1, and z / w is from 0 at znear to 1 at zfar. w is the depth. The fields of view are
    in radians."""
    matrix = torch.zeros(4, 4, device=device)
    matrix[0, 0], matrix[1, 1] = 1 / math.tan(fovX / 2), 1 / math.tan(fovY / 2)
    matrix[2, 2], matrix[2, 3] = zfar / (zfar - znear), -zfar * znear / (zfar - znear)
    matrix[3, 2] = 1
    return matrix
