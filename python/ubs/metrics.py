# SPDX-License-Identifier: Apache-2.0
"""Computes image metrics. Images are arrays (H, W, 3) of uint8, or of floating-point values from 0 to 1. Values
slightly outside of this range, which occur in rendered images, are clamped. An image with another range, such as 0 to
255, raises UsageError."""

from __future__ import annotations

import ctypes
import os
from typing import Sequence

import numpy as np
import numpy.typing as npt

from . import _abi
from ._abi import Kept
from ._data import c_pointer, floats
from ._device import DeviceLike, opened
from ._errors import UsageError
from ._model import as_float
from ._training import Metrics, meter_for, metrics_of

__all__ = ["lpips", "measure", "psnr", "ssim"]


def measure(
    truth: npt.ArrayLike,
    image: npt.ArrayLike,
    *,
    networks: Sequence[str] = (),
    weights: os.PathLike[str] | str | None = None,
    device: DeviceLike = None,
) -> Metrics:
    """Returns all metrics of an image. `networks` can contain the LPIPS networks "alex", "squeeze" and "vgg".
    `weights` is a safetensors file, or a folder with lpips_NAME.safetensors. If it is None, the environment variable
    UBS_LPIPS_WEIGHTS is used."""
    shape = np.shape(truth)
    if len(shape) != 3 or shape[2] != 3:
        raise UsageError(f"truth has the shape {shape}, but must be (H, W, 3)")
    a, b = floats(as_float(truth), shape, "truth"), floats(as_float(image), shape, "image")
    meter = meter_for(opened(device), networks, weights)
    found = _abi.Metrics()
    _abi.call(
        "meter_compare", meter, shape[1], shape[0], Kept(c_pointer(a), a), Kept(c_pointer(b), b),
        ctypes.byref(found),
    )
    return metrics_of(found)


def psnr(truth: npt.ArrayLike, image: npt.ArrayLike, device: DeviceLike = None) -> float:
    """Returns the PSNR in dB: the mean over the channels of 10 log10(1 / mse), as in published code. The result is
    infinite if the images are equal."""
    return measure(truth, image, device=device).psnr


def ssim(truth: npt.ArrayLike, image: npt.ArrayLike, device: DeviceLike = None) -> float:
    """Returns the SSIM with Gaussian windows of 11 x 11 pixels, where pixels outside of the images are 0, as in the
    training loss. measure() also returns the SSIM over the windows that are entirely inside the image."""
    return measure(truth, image, device=device).ssim


def lpips(
    truth: npt.ArrayLike,
    image: npt.ArrayLike,
    network: str = "alex",
    *,
    unit: bool = False,
    weights: os.PathLike[str] | str | None = None,
    device: DeviceLike = None,
) -> float:
    """Returns LPIPS, version 0.1. The network expects values from -1 to 1, so its input is 2 v - 1 for each value v.
    With `unit`, its input is v, as in published evaluations of splats."""
    found = measure(truth, image, networks=[network], weights=weights, device=device)
    value = getattr(found, f"lpips_{network}_unit" if unit else f"lpips_{network}")
    return float(value)
