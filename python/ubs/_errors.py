# SPDX-License-Identifier: Apache-2.0
"""The exceptions of the package, one for each kind of error of the library (include/ubs/ubs.h)."""

from __future__ import annotations

import re


class Error(Exception):
    """Base class of the errors that the library reports. The text of an error is a single line. It describes the
    error and its place, and often how to correct it."""


class InternalError(Error):
    """Raised if the library detects a bug in itself. Please report such an error."""


class UsageError(Error, ValueError):
    """Raised if an argument or a setting is wrong."""


class DataError(Error):
    """Raised if input is unreadable, corrupt or inconsistent, or if a file cannot be written."""


class DeviceError(Error):
    """Raised if a requested device does not exist, or if its driver fails."""


class BuildError(Error):
    """Raised if the driver of a device cannot compile the kernels."""


class OutOfMemoryError(Error, MemoryError):
    """Raised if the memory of the host or of the device is not sufficient."""


class NumericalError(Error, ArithmeticError):
    """Raised if a value is not finite."""


class FaultyDeviceError(DeviceError):
    """Raised if a device computes wrong results."""


BY_STATUS: dict[int, type[Error]] = {
    1: InternalError,
    2: UsageError,
    3: DataError,
    4: DeviceError,
    5: BuildError,
    6: OutOfMemoryError,
    7: NumericalError,
    10: FaultyDeviceError,
}


def in_python_terms(message: str) -> str:
    """Replaces the names of the C interface in a message of the library by those of this package."""
    message = re.sub(r"\bUBS_RENDER_(\w+)", lambda found: f"{found[1].lower()}=True", message)
    message = re.sub(r"\bUBS_ARRAY_(\w+)", lambda found: f'array("{found[1].lower()}")', message)
    message = re.sub(r"\bubs_renderer_(\w+)", r"\1()", message)
    message = re.sub(r"\bv_image\.more\w*", "more", message)
    return re.sub(r"\bv_image\.(rgb|alpha|depth)\b", r"v_\1", message)
