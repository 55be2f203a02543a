# SPDX-License-Identifier: Apache-2.0
"""The exceptions of the package, one for each kind of error of the library (include/ubs/ubs.h)."""

from __future__ import annotations


class Error(Exception):
    """Base class of the errors that the library reports. The text is one line: what is wrong, where, and what to do."""


class InternalError(Error):
    """A bug in the library: please report it."""


class UsageError(Error, ValueError):
    """Wrong arguments or settings."""


class DataError(Error):
    """Unreadable, corrupt or inconsistent input, or a file that cannot be written."""


class DeviceError(Error):
    """No such device, or a failure of its driver."""


class BuildError(Error):
    """Kernels do not compile on this device."""


class OutOfMemoryError(Error, MemoryError):
    """Not enough memory, of the host or the device."""


class NumericalError(Error, ArithmeticError):
    """A value that is not finite."""


class FaultyDeviceError(DeviceError):
    """A device that computes wrong results."""


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
