# SPDX-License-Identifier: Apache-2.0
"""Devices."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Union

import numpy as np

from . import _abi
from ._errors import DeviceError


@dataclass(frozen=True)
class DeviceInfo:
    """A device as `ubs devices` lists it; sizes in bytes."""

    index: int
    name: str
    backend: str
    platform: str
    vendor: str
    driver: str
    type: str
    """cpu, gpu or accelerator."""
    compute_units: int
    memory_bytes: int
    max_allocation_bytes: int


def devices() -> list[DeviceInfo]:
    """All devices of this machine."""
    count = ctypes.c_size_t()
    _abi.call("device_count", ctypes.byref(count))
    found = []
    for index in range(count.value):
        info = _abi.DeviceInfo()
        _abi.call("device_describe", index, ctypes.byref(info))
        found.append(
            DeviceInfo(
                index=index,
                name=_abi.text(info.name),
                backend=_abi.text(info.backend),
                platform=_abi.text(info.platform),
                vendor=_abi.text(info.vendor),
                driver=_abi.text(info.driver),
                type=("cpu", "gpu", "accelerator")[info.type],
                compute_units=info.compute_units,
                memory_bytes=info.memory_bytes,
                max_allocation_bytes=info.max_allocation_bytes,
            )
        )
    return found


def request_text(request: Union[str, int, None]) -> str:
    """As the library takes it. A bool, which is an int, counts no devices."""
    if request is None:
        return ""
    if isinstance(request, str):
        return request
    if isinstance(request, (int, np.integer)) and not isinstance(request, bool):
        if request < 0:  # whose text the library would look for in names
            raise DeviceError(f"there is no device {request}")
        return str(int(request))
    raise TypeError(f"a device is an index, a text or a ubs.Device, not {type(request).__name__}")


class Device(_abi.Handle):
    """An open device. `request`: an index as `ubs devices` counts, "cpu", "gpu", "cuda", "opencl", or a part of a
    name; "": UBS_DEVICE, else the first GPU, else the first device. Functions that take a device take such a request
    too, and open it once."""

    def __init__(self, request: Union[str, int] = "") -> None:
        super().__init__("device", "device_open", request_text(request).encode())

    @property
    def allocated_bytes(self) -> int:
        """Device memory in use by what has been made of this object."""
        info = _abi.DeviceInfo()
        _abi.call("device_get_info", self, ctypes.byref(info))
        return int(info.allocated_bytes)


DeviceLike = Union[Device, str, int, None]
_opened: dict[str, Device] = {}


def opened(device: DeviceLike) -> Device:
    if isinstance(device, Device):
        return device
    request = request_text(device)
    if request not in _opened:
        _opened[request] = Device(request)
    return _opened[request]
