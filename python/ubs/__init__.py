# SPDX-License-Identifier: Apache-2.0
"""Universal Beta Splatting: learn scenes from images, draw them, and differentiate what is drawn.

    import ubs
    data = ubs.Dataset.open("scene")
    model = ubs.train(data, dim=6, iterations=7000)
    image = model.render(data.test[0].camera)        # numpy, (H, W, 3)

Any device with OpenCL or CUDA, CPUs too. ubs.torch and ubs.jax are imported by their names alone."""

from . import metrics
from ._abi import version as _version
from ._data import Camera, Dataset, View
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
    "train",
    "vjp",
]
