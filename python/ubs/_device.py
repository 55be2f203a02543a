# SPDX-License-Identifier: Apache-2.0
"""Opens and lists devices."""

from __future__ import annotations

import ctypes
import threading
from dataclasses import dataclass
from typing import Any, Union

import numpy as np

from . import _abi
from ._errors import DeviceError


@dataclass(frozen=True)
class DeviceInfo:
    """The description of a device, as `ubs devices` lists it. Sizes are in bytes."""

    index: int
    name: str
    backend: str
    platform: str
    vendor: str
    driver: str
    type: str
    """The type of the device: "cpu", "gpu" or "accelerator"."""
    compute_units: int
    memory_bytes: int
    max_allocation_bytes: int


def devices() -> list[DeviceInfo]:
    """Returns all devices of this machine."""
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
    """Converts the request to the text that the library expects. Rejects bool, which is a subclass of int, but not the
    index of a device."""
    if request is None:
        return ""
    if isinstance(request, str):
        return request
    if isinstance(request, (int, np.integer)) and not isinstance(request, bool):
        if request < 0:  # the library would search for a text such as "-1" in the names of devices
            raise DeviceError(f"there is no device {request}")
        return str(int(request))
    raise TypeError(f"a device is an index, a text or a ubs.Device, not {type(request).__name__}")


class Device(_abi.Handle):
    """An open device. `request` is an index in the order of `ubs devices`, "cpu", "gpu", "cuda", "opencl", or a part of
    a name. An empty text selects the device in UBS_DEVICE. If that variable is not set, it selects the first GPU, or
    the first device if there is no GPU. Functions that take a device also accept such a request, and open the device
    once."""

    def __init__(self, request: Union[str, int] = "") -> None:
        self._request = request_text(request)
        super().__init__("device", "device_open", self._request.encode())

    def __repr__(self) -> str:
        info = _abi.DeviceInfo()
        _abi.call("device_get_info", self, ctypes.byref(info))
        return f"<ubs.Device {_abi.text(info.name)!r} ({_abi.text(info.backend)})>"

    def __reduce_ex__(self, _protocol: Any) -> Any:
        return opened, (self._request,)

    @property
    def allocated_bytes(self) -> int:
        """Device memory in use by objects that were created with this device, in bytes."""
        info = _abi.DeviceInfo()
        _abi.call("device_get_info", self, ctypes.byref(info))
        return int(info.allocated_bytes)


DeviceLike = Union[Device, str, int, None]
_opened: dict[str, Device] = {}
_opened_lock = threading.Lock()


def opened(device: DeviceLike) -> Device:
    if isinstance(device, Device):
        return device
    request = request_text(device)
    with _opened_lock:  # several threads may make the first request at the same time
        if request not in _opened:
            _opened[request] = Device(request)
        return _opened[request]
