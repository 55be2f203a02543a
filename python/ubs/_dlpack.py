# SPDX-License-Identifier: Apache-2.0
"""Shares device memory with other packages through DLPack: torch.from_dlpack, cupy.from_dlpack and so on."""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_char_p, c_int32, c_int64, c_uint8, c_uint16, c_uint64, c_void_p
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _abi
from ._errors import UsageError

_NAME = b"dltensor"  # name of a capsule that has not been consumed yet
_FLOAT = 2


class _Tensor(ctypes.Structure):
    """The struct DLManagedTensor of DLPack."""

    _fields_ = [
        ("data", c_void_p),
        ("type", c_int32),
        ("ordinal", c_int32),
        ("dims", c_int32),
        ("code", c_uint8),
        ("bits", c_uint8),
        ("lanes", c_uint16),
        ("shape", POINTER(c_int64)),
        ("strides", POINTER(c_int64)),
        ("byte_offset", c_uint64),
        ("context", c_void_p),
        ("deleter", c_void_p),
    ]


_handed_out: dict[int, tuple[Any, ...]] = {}  # objects that a tensor needs until its consumer deletes it


_python: Any = ctypes.pythonapi
_new, _valid, _pointer = _python.PyCapsule_New, _python.PyCapsule_IsValid, _python.PyCapsule_GetPointer
_new.argtypes, _new.restype = [c_void_p, c_char_p, c_void_p], ctypes.py_object
# These functions take a pointer, because a capsule that is being destroyed must not be referenced again.
_valid.argtypes = _pointer.argtypes = [c_void_p, c_char_p]
_pointer.restype = c_void_p


def _capsule_dies(capsule: int) -> None:
    if _valid(capsule, _NAME):
        _handed_out.pop(_pointer(capsule, _NAME))


_function = ctypes.CFUNCTYPE(None, c_void_p)
# The deleter is a function in C. At the start of a function in Python, handlers of signals could run and raise an
# exception, which would be lost, because the consumer calls the deleter from C.
_deleter, _destructor = _function(_handed_out.pop), _function(_capsule_dies)


class DeviceArray:
    """An array of float32 values in the memory of a device. The values belong to a renderer, which this object keeps
    alive."""

    def __init__(self, owner: object, array: _abi.Array) -> None:
        self._owner = owner
        self._array = array
        self.shape: tuple[int, ...] = tuple(array.shape[: array.dims])

    @property
    def address(self) -> int:
        """The address of the first value in the memory of the device."""
        return int(self._array.values)

    def __dlpack_device__(self) -> tuple[int, int]:
        return int(self._array.type), int(self._array.ordinal)

    def seen(self) -> npt.NDArray[np.float32]:
        """Returns the same memory as a NumPy array. Requires a device that is a CPU."""
        if self._array.type != 1:
            raise UsageError("the values are in the memory of a GPU")
        return np.asarray(self)

    @property
    def __array_interface__(self) -> dict[str, Any]:
        """Lets np.asarray(array) use the memory without copying it. Requires a device that is a CPU."""
        a = self._array
        if a.type != 1:
            raise AttributeError("the values are in the memory of a GPU")
        steps = tuple(4 * step for step in a.strides[: a.dims])
        return {"version": 3, "shape": self.shape, "strides": steps, "typestr": "<f4", "data": (self.address, False)}

    def __dlpack__(self, **_: Any) -> Any:
        """Returns a DLPack capsule. Streams can be ignored, because the library has already waited for the device."""
        a = self._array
        sizes, steps = (c_int64 * 3)(*a.shape), (c_int64 * 3)(*a.strides)
        tensor = _Tensor(a.values, a.type, a.ordinal, a.dims, _FLOAT, 32, 1, sizes, steps)
        tensor.deleter = ctypes.cast(_deleter, c_void_p)
        address = ctypes.addressof(tensor)
        _handed_out[address] = (tensor, sizes, steps, self)
        return _new(address, _NAME, ctypes.cast(_destructor, c_void_p))
