# SPDX-License-Identifier: Apache-2.0
"""The function of gsplat's module of this name that trainers use. Others are refused when they are called."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from ..._errors import UsageError
from ..absent import refusing
from ..rendering import _harmonics


def _eval_sh_bases_fast(basis_dim: int, dirs: Tensor) -> Tensor:
    """Returns the values (..., basis_dim) of the spherical harmonics at unit vectors `dirs` (..., 3). `basis_dim` is 1,
    4, 9, 16 or 25."""
    if basis_dim not in (1, 4, 9, 16, 25):
        raise UsageError(f"basis_dim={basis_dim} must be 1, 4, 9, 16 or 25")
    return torch.stack(_harmonics(math.isqrt(basis_dim) - 1, *dirs.unbind(-1)), -1)


def __getattr__(name: str) -> Any:
    return refusing(__name__, name)
