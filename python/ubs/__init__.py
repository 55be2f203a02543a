# SPDX-License-Identifier: Apache-2.0
"""Universal Beta Splatting: train models of scenes from images, render them, and differentiate rendered images.

    import ubs
    data = ubs.synth("glossy")                       # or ubs.Dataset.open("scene")
    model = ubs.train(data, dim=6, iterations=7000)
    image = model.render(data.test[0].camera)        # numpy, (H, W, 3)

The package runs on any device with OpenCL or CUDA, including CPUs. ubs.torch, ubs.gsplat and ubs.jax must be imported
explicitly."""

from . import metrics
from ._abi import version as _version
from ._data import Camera, Dataset, View, synth
from ._device import Device, DeviceInfo, devices
from ._errors import (
    BuildError,
    DataError,
    DeviceError,
    Error,
    FaultyDeviceError,
    InternalError,
    NumericalError,
    OutOfMemoryError,
    UsageError,
)
from ._falloff import Falloff
from ._model import CameraGradient, Image, Loss, Model, Renderer, loss, vjp
from ._settings import settings
from ._training import Metrics, Step, Trainer, train

__version__ = _version()
__all__ = [
    "BuildError",
    "Camera",
    "CameraGradient",
    "DataError",
    "Dataset",
    "Device",
    "DeviceError",
    "DeviceInfo",
    "Error",
    "Falloff",
    "FaultyDeviceError",
    "Image",
    "InternalError",
    "Loss",
    "Metrics",
    "Model",
    "NumericalError",
    "OutOfMemoryError",
    "Renderer",
    "Step",
    "Trainer",
    "UsageError",
    "View",
    "devices",
    "loss",
    "metrics",
    "settings",
    "synth",
    "train",
    "vjp",
]
