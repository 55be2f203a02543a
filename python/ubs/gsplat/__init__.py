# SPDX-License-Identifier: Apache-2.0
"""Provides functions of gsplat 1.5 (https://github.com/nerfstudio-project/gsplat) on every device of ubs, with the same
names, arguments and results. So scripts for gsplat can run on machines without CUDA. docs/gsplat.md lists the supported
functions and arguments.

    from ubs.gsplat import rasterization
    images, alphas, meta = rasterization(means, quats, scales, opacities, colors, viewmats, Ks, width, height)

Other names of gsplat can be imported, but calling them raises a UsageError that states what to use instead (absent.py).

The module requires PyTorch, but not gsplat. Several threads may call its functions at the same time."""

from typing import Any

from .absent import refusing
from .cuda._wrapper import proj, quat_scale_to_covar_preci, world_to_cam
from .exporter import export_splats
from .optimizers import SelectiveAdam
from .rendering import (
    CameraModel,
    RasterizeMode,
    RenderMode,
    RollingShutterType,
    fully_fused_projection,
    rasterization,
    spherical_harmonics,
)
from .strategy import DefaultStrategy, MCMCStrategy, Strategy
from .tiles import isect_offset_encode, isect_tiles

__version__ = "1.5"  # the version of gsplat whose interface this module provides
__all__ = [
    "CameraModel",
    "DefaultStrategy",
    "MCMCStrategy",
    "RasterizeMode",
    "RenderMode",
    "RollingShutterType",
    "SelectiveAdam",
    "Strategy",
    "export_splats",
    "fully_fused_projection",
    "isect_offset_encode",
    "isect_tiles",
    "proj",
    "quat_scale_to_covar_preci",
    "rasterization",
    "spherical_harmonics",
    "world_to_cam",
]


def __getattr__(name: str) -> Any:
    return refusing(__name__, name)
