# SPDX-License-Identifier: Apache-2.0
"""Declares the C interface of the library (include/ubs/ubs.h) for ctypes: its structs, functions and handles. This
module is internal to the package."""

from __future__ import annotations

import atexit
import ctypes
import logging
import math
import operator
import os
from ctypes import POINTER, c_char, c_char_p, c_double, c_float, c_int, c_int32, c_size_t, c_uint
from ctypes import c_int64, c_uint32, c_uint64, c_void_p
from pathlib import Path
from typing import Any, Callable

from ._errors import BY_STATUS, DeviceError, Error, UsageError, in_python_terms

ABI_VERSION = 1
logger = logging.getLogger("ubs")


def _open() -> ctypes.CDLL:
    """Loads the library: the file in UBS_LIBRARY, or the one in the package, or the one that the system finds."""
    name = f"libubs.so.{ABI_VERSION}"
    chosen = os.environ.get("UBS_LIBRARY")
    own = Path(__file__).parent / "lib" / name
    path = chosen if chosen else str(own) if own.exists() else name
    try:
        library = ctypes.CDLL(path)
    except OSError as error:
        raise ImportError(f"the library of ubs cannot be loaded: {error}: set UBS_LIBRARY to its path") from None
    version = int(library.ubs_abi_version())
    if version != ABI_VERSION:
        raise ImportError(f"{path} has interface version {version}, but this package requires {ABI_VERSION}")
    return library


class Struct(ctypes.Structure):
    """A struct of ubs.h that starts with its size."""

    def __init__(self, **values: Any) -> None:
        super().__init__(**values)
        self.size = ctypes.sizeof(self)


class DeviceInfo(Struct):
    _fields_ = [
        ("size", c_size_t),
        ("backend", c_char * 16),
        ("platform", c_char * 128),
        ("vendor", c_char * 128),
        ("name", c_char * 256),
        ("driver", c_char * 128),
        ("type", c_int32),
        ("compute_units", c_uint32),
        ("memory_bytes", c_uint64),
        ("max_allocation_bytes", c_uint64),
        ("allocated_bytes", c_uint64),
        ("peak_bytes", c_uint64),
    ]


class Camera(Struct):
    _fields_ = [
        ("size", c_size_t),
        ("world_to_camera", c_double * 12),
        ("fx", c_double),
        ("fy", c_double),
        ("cx", c_double),
        ("cy", c_double),
        ("width", c_int32),
        ("height", c_int32),
        ("time", c_double),
        ("extra_count", c_uint32),
        ("extra", c_double * 4),
    ]


class Synthetic(Struct):
    _fields_ = [
        ("size", c_size_t),
        ("scene", c_char_p),
        ("width", c_int32),
        ("height", c_int32),
        ("train_views", c_int32),
        ("test_views", c_int32),
        ("val_views", c_int32),
        ("supersampling", c_int32),
        ("seed", c_uint64),
        ("overwrite", c_int32),
    ]


class View(Struct):
    _fields_ = [
        ("size", c_size_t),
        ("camera", Camera),
        ("has_image", c_int32),
        ("has_mask", c_int32),
        ("name", c_char * 256),
    ]


class ModelInfo(Struct):
    _fields_ = [
        ("size", c_size_t),
        ("dim", c_uint32),
        ("groups", c_uint32),
        ("splats", c_uint64),
        ("parameters", c_uint64),
        ("offset", c_double * 3),
        ("form", c_char * 256),
    ]


class Parameter(Struct):
    _fields_ = [
        ("size", c_size_t),
        ("name", c_char_p),
        ("dim", c_uint32),
        ("rows", c_uint32),
        ("splats", c_uint64),
        ("values", POINTER(c_float)),
    ]


class Image(Struct):
    _fields_ = [("size", c_size_t), ("rgb", c_void_p), ("alpha", c_void_p), ("depth", c_void_p), ("for_gradient", c_int32)]


class ImageGradient(Struct):
    _fields_ = [
        ("size", c_size_t),
        ("rgb", c_void_p),
        ("alpha", c_void_p),
        ("depth", c_void_p),
        ("more_channels", c_uint32),
        ("more", c_void_p),
        ("more_image", c_void_p),
        ("more_colours", c_void_p),
    ]


class CameraGradient(Struct):
    _fields_ = [
        ("size", c_size_t),
        ("pose", c_double * 6),
        ("world_to_camera", c_double * 12),
        ("fx", c_double),
        ("fy", c_double),
        ("cx", c_double),
        ("cy", c_double),
        ("time", c_double),
        ("extra", c_double * 4),
    ]


class Array(Struct):
    _fields_ = [
        ("size", c_size_t),
        ("values", c_void_p),
        ("type", c_int32),
        ("ordinal", c_int32),
        ("dims", c_int32),
        ("shape", c_int64 * 3),
        ("strides", c_int64 * 3),
    ]


# The names of a renderer's arrays, in the order of the enumeration ubs_array_name
ARRAYS = ("parameters", "rgb", "transmittance", "depth", "v_rgb", "gradient", "extents", "v_means2d", "means2d",
          "depths", "opacities", "v_alpha", "v_depth")


class Gaussians(Struct):
    _fields_ = [
        ("size", c_size_t),
        ("count", c_uint64),
        ("means", c_void_p),
        ("quats", c_void_p),
        ("scales", c_void_p),
        ("opacities", c_void_p),
        ("colours", c_void_p),
        ("bases", c_uint32),
    ]


class Falloff(Struct):
    _fields_ = [("size", c_size_t), ("log2", c_char_p), ("r_slope", c_char_p), ("beta_slope", c_char_p), ("support", c_float)]


class Loss(Struct):
    _fields_ = [("size", c_size_t), ("loss", c_double), ("l1", c_double), ("ssim", c_double)]


class Step(Struct):
    _fields_ = [
        ("size", c_size_t),
        ("iteration", c_uint32),
        ("iterations", c_uint32),
        ("seconds", c_double),
        ("splats", c_uint64),
        ("loss", c_double),
        ("test_psnr", c_double),
        ("test_ssim", c_double),
    ]


METRICS = ("psnr", "psnr_joint", "ssim", "ssim_valid", "lpips_alex", "lpips_squeeze", "lpips_vgg",
           "lpips_alex_unit", "lpips_squeeze_unit", "lpips_vgg_unit")


class Metrics(Struct):
    _fields_ = [("size", c_size_t)] + [(name, c_double) for name in METRICS]


StepFunction = ctypes.CFUNCTYPE(c_int, c_void_p, POINTER(Step))
LogFunction = ctypes.CFUNCTYPE(None, c_void_p, c_int, c_char_p)

RENDER_DEPTH, RENDER_GRADIENTS, RENDER_ABSGRAD, RENDER_GAUSSIANS = 1, 2, 4, 8
USE_DATA, USE_MODEL, USE_RENDERER, USE_TRAINER = 0, 1, 2, 3


def _of(kind: str) -> Any:
    """Returns the type of an argument that is a handle of this kind. Any other object raises TypeError, because its
    address would be interpreted as a handle."""

    def from_param(value: Any) -> Any:
        if value is not None and not (isinstance(value, Handle) and value._kind == kind):
            raise TypeError(f"expected a handle of kind '{kind}', not {type(value).__name__}")
        return None if value is None else value._as_parameter_

    return type(kind, (), {"from_param": staticmethod(from_param)})


_KINDS = ("device", "settings", "data", "model", "renderer", "trainer", "meter")
_device, _settings, _data, _model, _renderer, _trainer, _meter = (_of(kind) for kind in _KINDS)
_out = POINTER(c_void_p)
# The argument types of the functions. Each function returns a status.
_FUNCTIONS: dict[str, list[Any]] = {
    "device_count": [POINTER(c_size_t)],
    "device_describe": [c_size_t, POINTER(DeviceInfo)],
    "device_open": [c_char_p, _out],
    "device_get_info": [_device, POINTER(DeviceInfo)],
    "settings_create": [_out],
    "settings_load": [_settings, c_char_p],
    "settings_set": [_settings, c_char_p, c_char_p],
    "settings_check": [_settings, c_int],
    "settings_describe": [c_size_t, POINTER(c_char_p), POINTER(c_char_p)],
    "data_synthesise": [POINTER(Synthetic), c_char_p],
    "data_open": [c_char_p, _settings, _out],
    "data_create": [_out],
    "data_add_view": [_data, c_char_p, c_char_p, POINTER(Camera), c_void_p, c_void_p],
    "data_set_points": [_data, c_size_t, c_void_p, c_void_p],
    "data_view_count": [_data, c_char_p, POINTER(c_size_t)],
    "data_get_view": [_data, c_char_p, c_size_t, POINTER(View)],
    "data_get_image": [_data, c_char_p, c_size_t, c_void_p, c_void_p],
    "model_create": [_settings, c_uint64, _out],
    "model_create_initial": [_data, _settings, _out],
    "model_create_like": [_model, c_uint64, _out],
    "model_copy": [_model, _out],
    "model_load": [c_char_p, _out],
    "model_save": [_model, c_char_p, c_char_p, c_double],
    "model_get_info": [_model, POINTER(ModelInfo)],
    "model_get_parameter": [_model, c_uint32, c_uint32, POINTER(Parameter)],
    "model_get_settings": [_model, _out],
    "renderer_create_falloff": [_device, _model, _settings, c_uint, POINTER(Falloff), _out],
    "renderer_update": [_renderer, _model],
    "renderer_set_gaussians": [_renderer, POINTER(Gaussians)],
    "renderer_get_gaussian_gradients": [_renderer, POINTER(Gaussians)],
    "renderer_draw": [_renderer, POINTER(Camera), POINTER(Image)],
    "renderer_vjp": [_renderer, POINTER(Camera), POINTER(ImageGradient), _model],
    "renderer_loss": [_renderer, POINTER(Camera), c_void_p, c_void_p, c_float, POINTER(Loss), _model],
    "renderer_camera_gradient": [_renderer, POINTER(CameraGradient)],
    "renderer_get_array": [_renderer, c_int, c_uint32, POINTER(Array)],
    "trainer_create": [_device, _data, _settings, _model, _out],
    "trainer_run": [_trainer, c_uint32, StepFunction, c_void_p],
    "trainer_get_status": [_trainer, POINTER(Step)],
    "trainer_get_model": [_trainer, _out],
    "trainer_set_model": [_trainer, _model, c_void_p],
    "trainer_evaluate": [_trainer, POINTER(Metrics)],
    "trainer_save": [_trainer, c_char_p],
    "trainer_restore": [_trainer, c_char_p],
    "meter_create": [_device, c_char_p, c_char_p, _out],
    "meter_compare": [_meter, c_int32, c_int32, c_void_p, c_void_p, POINTER(Metrics)],
}

_library = _open()
_library.ubs_version.restype = c_char_p
_library.ubs_error_message.restype = c_char_p
_library.ubs_set_log.argtypes = [LogFunction, c_void_p]
_library.ubs_set_log.restype = None
_functions: dict[str, Any] = {}
for _name, _arguments in _FUNCTIONS.items():
    _functions[_name] = getattr(_library, "ubs_" + _name)
    _functions[_name].argtypes = _arguments
    _functions[_name].restype = c_int
_free: dict[str, Callable[[c_void_p], None]] = {}
for _kind in _KINDS:
    _free[_kind] = getattr(_library, f"ubs_{_kind}_free")
    _free[_kind].argtypes = [c_void_p]  # type: ignore[attr-defined]
    _free[_kind].restype = None  # type: ignore[attr-defined]


def version() -> str:
    return str(_library.ubs_version().decode())


_LIMITS = {c_int: (-(2**31), 2**31), c_int32: (-(2**31), 2**31), c_uint: (0, 2**32), c_uint32: (0, 2**32),
           c_size_t: (0, 2**64), c_uint64: (0, 2**64)}


def integer(value: Any, what: str, least: float = -math.inf) -> int:
    """Converts an integer of any type, such as those of NumPy, to int. Raises UsageError for other values, and for
    integers below `least`."""
    try:
        found = operator.index(value)
        if found >= least:
            return found
    except TypeError:
        pass
    raise UsageError(f"{what} must be an integer{'' if least == -math.inf else f' of at least {least}'}, not {value}")


def _check_integers(name: str, arguments: tuple[Any, ...]) -> None:
    """Raises UsageError for values that are not integers, and for integers that do not fit into the type of their
    argument. For the latter, ctypes would not raise an error, but pass only the lower bits."""
    for kind, value in zip(_FUNCTIONS[name], arguments):
        if kind in _LIMITS:
            low, end = _LIMITS[kind]
            if not low <= integer(value, f"ubs_{name}: an argument") < end:
                raise UsageError(f"ubs_{name}: {value} is not an integer from {low} to {end - 1}")


# Names of functions that use a driver start with one of these words. Drivers have threads, which do not exist in a
# forked process, so the first call to a driver would wait forever. Functions that only use the host work after a fork.
_DRIVEN = ("device", "renderer", "trainer", "meter")
_drivers_are_loaded = _drivers_are_lost = False


def _after_fork() -> None:
    global _drivers_are_lost
    _drivers_are_lost = _drivers_are_loaded


os.register_at_fork(after_in_child=_after_fork)


def call(name: str, *arguments: Any) -> None:
    """Calls ubs_NAME. Raises an exception if the status is not UBS_OK."""
    global _drivers_are_loaded
    if name.startswith(_DRIVEN):
        if _drivers_are_lost:
            raise DeviceError(
                "this process was forked from a process that had used a device, so device drivers do not work in it: "
                'start it with multiprocessing.get_context("spawn"), or do not use a device before the fork'
            )
        _drivers_are_loaded = True
    _check_integers(name, arguments)
    status = _functions[name](*arguments)
    if status != 0:
        kind = BY_STATUS.get(status, Error)
        raise kind(in_python_terms(_library.ubs_error_message().decode("utf-8", "replace")))


class Handle:
    """Owns a handle of the library, and frees the handle when this object is deleted."""

    def __init__(self, kind: str, maker: str, *arguments: Any) -> None:
        self._kind = kind
        # The value that ctypes passes to the library. Callers pass the Handle object itself to call(), so that the
        # handle is not freed before the call returns.
        self._as_parameter_ = c_void_p()
        call(maker, *arguments, ctypes.byref(self._as_parameter_))

    def __reduce_ex__(self, _protocol: Any) -> Any:
        raise TypeError(f"a {type(self).__name__} cannot be pickled or copied")

    def __del__(self) -> None:
        if getattr(self, "_as_parameter_", None):
            if not (_drivers_are_lost and self._kind in _DRIVEN):  # the driver would wait for its threads
                _free[self._kind](self._as_parameter_)
            self._as_parameter_ = c_void_p()


def path_bytes(path: os.PathLike[str] | str) -> bytes:
    name = os.fsencode(path)
    if b"\0" in name:
        raise UsageError(f"{path!r} is not a valid path, because it contains a NUL character")
    return name


def text(value: bytes) -> str:
    return value.decode("utf-8", "replace")


def _to_logging(_user: int, level: int, line: bytes) -> None:
    logger.log(logging.WARNING if level else logging.INFO, "%s", text(line))


_log = LogFunction(_to_logging)
_library.ubs_set_log(_log, None)


@atexit.register
def _no_log() -> None:
    """Removes the log function, because the library may still write log lines after the interpreter has ended."""
    _library.ubs_set_log(LogFunction(0), None)
