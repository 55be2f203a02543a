# SPDX-License-Identifier: Apache-2.0
"""Checks of arguments. All functions raise UsageError with the name of the argument; values that are not finite raise
NumericalError."""

from __future__ import annotations

import math
from typing import Any, Sequence

import torch
from torch import Tensor

from .._errors import NumericalError, UsageError
from .._raster import is_finite
from .._settings import BOOLEANS


def check_choice(name: str, value: Any, known: Sequence[str]) -> None:
    """Checks that the value is one of the known ones."""
    if value not in known:
        raise UsageError(f"{name}={value!r} is not supported: choose one of {', '.join(map(repr, known))}")


def check_tensor(
    name: str, tensor: Any, *shapes: tuple[int, ...], like: Tensor | None = None, double: bool = False
) -> Tensor:
    """Checks that the argument is a tensor of one of these shapes with finite float32 values, and that it is on the
    device of the tensor `like`. With `double`, which is for functions that PyTorch alone computes, the values may also
    be float64 if those of `like` are."""
    if not isinstance(tensor, Tensor):
        raise UsageError(f"{name} must be a torch.Tensor, not {type(tensor).__name__}")
    if tensor.dtype != torch.float32 and not (double and tensor.dtype == torch.float64):
        wanted = "torch.float32 or torch.float64" if double else "torch.float32"
        raise UsageError(f"{name} has the type {tensor.dtype}, but must be {wanted}")
    if double and like is not None and tensor.dtype != like.dtype:
        raise UsageError(f"{name} has the type {tensor.dtype}, but other tensors are {like.dtype}")
    if tuple(tensor.shape) not in shapes:
        wanted = " or ".join(dict.fromkeys(map(str, shapes)))
        raise UsageError(f"{name} has the shape {tuple(tensor.shape)}, not {wanted}")
    if like is not None and tensor.device != like.device:
        raise UsageError(f"{name} is on {tensor.device}, but means is on {like.device}: move it there")
    if not is_finite(tensor):
        raise NumericalError(f"{name} contains values that are not finite")
    return tensor


def shape_of(name: str, tensor: Any, at_least: int) -> tuple[int, ...]:
    """Returns the shape of a tensor, which must have this number of dimensions or more."""
    if not isinstance(tensor, Tensor) or tensor.dim() < at_least:
        raise UsageError(f"{name} must be a torch.Tensor with at least {at_least} dimensions")
    return tuple(tensor.shape)


def number(name: str, value: Any, infinite: bool = False) -> float:
    """Converts a number of at least 0 of any type, such as a tensor with one value. `infinite` says whether it may be
    infinite."""
    try:
        found = float(value)
    except (TypeError, ValueError, RuntimeError):  # the last one is raised for tensors with several values
        found = math.nan
    if not (0 <= found < math.inf or (infinite and found == math.inf)):
        shown = " ".join(repr(value).split())  # a tensor is shown on several lines
        raise UsageError(f"{name}={shown} must be a {'' if infinite else 'finite '}number of at least 0")
    return found


def whole_number(name: str, value: Any, most: int = 65536) -> int:
    """Converts a whole number from 1 to `most` of any type."""
    found = 0.5 if isinstance(value, BOOLEANS) else number(name, value)
    if not (1 <= found <= most and found.is_integer()):
        raise UsageError(f"{name}={value!r} must be a whole number from 1 to {most}")
    return int(found)
