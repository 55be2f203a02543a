# SPDX-License-Identifier: Apache-2.0
"""Declares the C interface of the library (include/ubs/ubs.h) for ctypes: its structs, functions and handles. This
module is internal to the package."""

from __future__ import annotations

import _thread
import atexit
import ctypes
import logging
import math
import operator
import os
import threading
import time
from ctypes import CFUNCTYPE, POINTER, c_char, c_char_p, c_double, c_float, c_int, c_int32, c_size_t, c_uint
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


# The declarations of the header, written by python/tests/test_abi.py


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


class View(Struct):
    _fields_ = [
        ("size", c_size_t),
        ("camera", Camera),
        ("has_image", c_int32),
        ("has_mask", c_int32),
        ("name", c_char * 256),
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
        ("values", c_void_p),
    ]


class Image(Struct):
    _fields_ = [
        ("size", c_size_t),
        ("rgb", c_void_p),
        ("alpha", c_void_p),
        ("depth", c_void_p),
        ("for_gradient", c_int32),
    ]


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


class Loss(Struct):
    _fields_ = [
        ("size", c_size_t),
        ("loss", c_double),
        ("l1", c_double),
        ("ssim", c_double),
    ]


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
    _fields_ = [
        ("size", c_size_t),
        ("log2", c_char_p),
        ("r_slope", c_char_p),
        ("beta_slope", c_char_p),
        ("support", c_float),
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


class Metrics(Struct):
    _fields_ = [
        ("size", c_size_t),
        ("psnr", c_double),
        ("psnr_joint", c_double),
        ("ssim", c_double),
        ("ssim_valid", c_double),
        ("lpips_alex", c_double),
        ("lpips_squeeze", c_double),
        ("lpips_vgg", c_double),
        ("lpips_alex_unit", c_double),
        ("lpips_squeeze_unit", c_double),
        ("lpips_vgg_unit", c_double),
    ]


LogFunction = CFUNCTYPE(None, c_void_p, c_int, c_char_p)
StepFunction = CFUNCTYPE(c_int, c_void_p, POINTER(Step))
USE_DATA = 0
USE_MODEL = 1
USE_RENDERER = 2
USE_TRAINER = 3
RENDER_DEPTH = 1
RENDER_GRADIENTS = 2
RENDER_ABSGRAD = 4
RENDER_GAUSSIANS = 8
# The names of a renderer's arrays, in the order of their numbers
ARRAYS = (
    "parameters",
    "rgb",
    "transmittance",
    "depth",
    "v_rgb",
    "gradient",
    "extents",
    "v_means2d",
    "means2d",
    "depths",
    "opacities",
    "v_alpha",
    "v_depth",
)
# The kinds of handles, and the argument types of the functions, which return a status
HANDLES = ("device", "settings", "data", "model", "renderer", "trainer", "meter")
FUNCTIONS: dict[str, list[Any]] = {
    "device_count": [POINTER(c_size_t)],
    "device_describe": [c_size_t, POINTER(DeviceInfo)],
    "device_open": [c_char_p, POINTER(c_void_p)],
    "device_get_info": ["device", POINTER(DeviceInfo)],
    "settings_create": [POINTER(c_void_p)],
    "settings_copy": ["settings", POINTER(c_void_p)],
    "settings_load": ["settings", c_char_p],
    "settings_set": ["settings", c_char_p, c_char_p],
    "settings_get": ["settings", c_char_p, c_char_p, c_size_t, POINTER(c_size_t)],
    "settings_describe": [c_size_t, POINTER(c_char_p), POINTER(c_char_p)],
    "settings_check": ["settings", c_int],
    "data_open": [c_char_p, "settings", POINTER(c_void_p)],
    "data_synthesise": [POINTER(Synthetic), c_char_p],
    "data_create": [POINTER(c_void_p)],
    "data_add_view": ["data", c_char_p, c_char_p, POINTER(Camera), c_void_p, c_void_p],
    "data_set_points": ["data", c_size_t, c_void_p, c_void_p],
    "data_view_count": ["data", c_char_p, POINTER(c_size_t)],
    "data_get_view": ["data", c_char_p, c_size_t, POINTER(View)],
    "data_get_image": ["data", c_char_p, c_size_t, c_void_p, c_void_p],
    "model_create": ["settings", c_uint64, POINTER(c_void_p)],
    "model_create_initial": ["data", "settings", POINTER(c_void_p)],
    "model_copy": ["model", POINTER(c_void_p)],
    "model_create_like": ["model", c_uint64, POINTER(c_void_p)],
    "model_load": [c_char_p, POINTER(c_void_p)],
    "model_save": ["model", c_char_p, c_char_p, c_double],
    "model_get_info": ["model", POINTER(ModelInfo)],
    "model_get_parameter": ["model", c_uint32, c_uint32, POINTER(Parameter)],
    "model_get_settings": ["model", POINTER(c_void_p)],
    "renderer_create": ["device", "model", "settings", c_uint, POINTER(c_void_p)],
    "renderer_create_falloff": ["device", "model", "settings", c_uint, POINTER(Falloff), POINTER(c_void_p)],
    "renderer_update": ["renderer", "model"],
    "renderer_set_gaussians": ["renderer", POINTER(Gaussians)],
    "renderer_get_gaussian_gradients": ["renderer", POINTER(Gaussians)],
    "renderer_draw": ["renderer", POINTER(Camera), POINTER(Image)],
    "renderer_vjp": ["renderer", POINTER(Camera), POINTER(ImageGradient), "model"],
    "renderer_loss": ["renderer", POINTER(Camera), c_void_p, c_void_p, c_float, POINTER(Loss), "model"],
    "renderer_camera_gradient": ["renderer", POINTER(CameraGradient)],
    "renderer_get_array": ["renderer", c_int, c_uint32, POINTER(Array)],
    "trainer_create": ["device", "data", "settings", "model", POINTER(c_void_p)],
    "trainer_run": ["trainer", c_uint32, StepFunction, c_void_p],
    "trainer_get_status": ["trainer", POINTER(Step)],
    "trainer_get_settings": ["trainer", POINTER(c_void_p)],
    "trainer_get_model": ["trainer", POINTER(c_void_p)],
    "trainer_set_model": ["trainer", "model", c_void_p],
    "trainer_evaluate": ["trainer", POINTER(Metrics)],
    "trainer_evaluate_views": ["trainer", "meter", POINTER(Metrics), c_size_t, POINTER(Metrics)],
    "trainer_save": ["trainer", c_char_p],
    "trainer_restore": ["trainer", c_char_p],
    "meter_create": ["device", c_char_p, c_char_p, POINTER(c_void_p)],
    "meter_compare": ["meter", c_int32, c_int32, c_void_p, c_void_p, POINTER(Metrics)],
}
# The end of the declarations

METRICS = tuple(name for name, _ in Metrics._fields_[1:])


def _of(kind: str) -> Any:
    """Returns the type of an argument that is a handle of this kind. Any other object raises TypeError, because its
    address would be interpreted as a handle."""

    def from_param(value: Any) -> Any:
        if value is not None and not (isinstance(value, Handle) and value._kind == kind):
            raise TypeError(f"expected a handle of kind '{kind}', not {type(value).__name__}")
        return None if value is None else value._as_parameter_

    return type(kind, (), {"from_param": staticmethod(from_param)})


_types = {kind: _of(kind) for kind in HANDLES}
_library = _open()
_library.ubs_version.restype = c_char_p
_library.ubs_error_message.restype = c_char_p
_library.ubs_set_log.argtypes = [LogFunction, c_void_p]
_library.ubs_set_log.restype = None
_library.ubs_set_stop_flag.restype = None
_functions: dict[str, Any] = {}
for _name, _arguments in FUNCTIONS.items():
    _functions[_name] = getattr(_library, "ubs_" + _name)
    _functions[_name].argtypes = [_types.get(argument, argument) for argument in _arguments]
    _functions[_name].restype = c_int
_free: dict[str, Callable[[c_void_p], None]] = {}
for _kind in HANDLES:
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
    for kind, value in zip(FUNCTIONS[name], arguments):
        if kind in _LIMITS:
            low, end = _LIMITS[kind]
            if not low <= integer(value, f"ubs_{name}: an argument") < end:
                raise UsageError(f"ubs_{name}: {value} is not an integer from {low} to {end - 1}")


# Names of functions that use a driver start with one of these words. Drivers have threads, which do not exist in a
# forked process, so the first call to a driver would wait forever. Functions that only use the host work after a fork.
_DRIVEN = ("device", "renderer", "trainer", "meter")
_drivers_are_loaded = _drivers_are_lost = False


def _after_fork() -> None:
    global _drivers_are_lost, _idle, _calls
    _drivers_are_lost = _drivers_are_loaded
    _idle, _calls = threading.Condition(), 0  # the threads that made these calls do not exist in this process


os.register_at_fork(after_in_child=_after_fork)

# The number of calls of the library that threads other than the main thread are making. At the end of the program, the
# main thread waits for them, because the library must not work while the process destroys its global objects.
_idle = threading.Condition()
_calls = 0
_ended = False


def _in_main_thread() -> bool:
    return threading.get_ident() == threading.main_thread().ident


class _Working:
    """Counts a call of the library. After the main thread has ended, calls of other threads wait until the process
    ends, as Python lets such threads wait, too."""

    def __enter__(self) -> None:
        global _calls
        self._counted = not _in_main_thread()
        if self._counted:
            with _idle:
                ended = _ended
                _calls += not ended
            while ended:
                time.sleep(3600)

    def __exit__(self, *_: object) -> None:
        global _calls
        if self._counted:
            with _idle:
                _calls -= 1
                _idle.notify_all()


def _call_now(name: str, arguments: tuple[Any, ...]) -> None:
    with _Working():
        status = _functions[name](*arguments)
        message = "" if status == 0 else _library.ubs_error_message().decode("utf-8", "replace")
    if status != 0:
        raise BY_STATUS.get(status, Error)(in_python_terms(message))


# Functions that may take more than a fraction of a second.
_LONG = {"device_open", "data_open", "data_synthesise", "model_create_initial", "model_load", "model_save",
         "renderer_create_falloff", "trainer_create", "trainer_run", "trainer_evaluate_views", "trainer_save",
         "trainer_restore", "meter_create", "meter_compare"}
# Those that may be stopped halfway, because they only create an object.
_CREATING = {"device_open", "data_open", "data_synthesise", "model_create_initial", "renderer_create_falloff",
             "trainer_create", "meter_create"}
_PATIENCE = 1.0  # how long a call that is no longer needed delays an exception, in seconds


def _call_aside(name: str, arguments: tuple[Any, ...]) -> None:
    """Makes a call in another thread, and waits for it. Python runs signal handlers in the main thread only, and only
    between its own instructions: while the main thread waits here, but not while it works in the library. A handler
    that ran in a callback of the library would lose its exception, because it must not pass through C code.

    If a handler raises an exception, such as KeyboardInterrupt, this function asks the call to stop, and raises the
    exception. A training ends after its current iteration. If another call does not end soon, this function returns
    nevertheless; the call continues in its thread, which keeps its arguments, and its result is then deleted."""
    failures: list[BaseException] = []
    ended: list[bool] = []
    stop = c_int32(0)
    running = threading.Lock()
    running.acquire()

    def work() -> None:
        try:
            if name in _CREATING:
                _library.ubs_set_stop_flag(ctypes.byref(stop))
            _call_now(name, arguments)
        except BaseException as error:
            failures.append(error)
        finally:
            ended.append(True)
            running.release()

    # A handler may run between any two of these lines. threading.Thread.start() would wait for the thread, and a
    # handler that runs then would leave it open whether the thread exists.
    try:
        try:
            _thread.start_new_thread(work, ())
        except RuntimeError:  # the system has no more threads
            ended.append(True)
            raise
        running.acquire()
    except BaseException:
        stop.value = 1
        if not ended:
            running.acquire(timeout=-1 if name == "trainer_run" else _PATIENCE)
        raise
    if failures:
        raise failures.pop()


def call(name: str, *arguments: Any) -> None:
    """Calls ubs_NAME. Raises an exception if the status is not UBS_OK. If signal handlers raise an exception during a
    long call in the main thread, raises this exception. Arguments whose memory the library uses must be kept alive by
    the arguments themselves (Kept)."""
    global _drivers_are_loaded
    if name.startswith(_DRIVEN):
        if _drivers_are_lost:
            raise DeviceError(
                "this process was forked from a process that had used a device, so device drivers do not work in it: "
                'start it with multiprocessing.get_context("spawn"), or do not use a device before the fork'
            )
        _drivers_are_loaded = True
    _check_integers(name, arguments)
    aside = name in _LONG and _in_main_thread()
    (_call_aside if aside else _call_now)(name, arguments)


class Kept:
    """An argument of call() that keeps another object alive until the call has ended."""

    def __init__(self, value: Any, owner: object) -> None:
        self._as_parameter_, self._owner = value, owner


class Handle:
    """Owns a handle of the library, and frees the handle when this object is deleted."""

    def __init__(self, kind: str, maker: str, *arguments: Any) -> None:
        self._kind = kind
        # The value that ctypes passes to the library. Callers pass the Handle object itself to call(), so that the
        # handle is not freed before the call returns.
        self._as_parameter_ = c_void_p()
        call(maker, *arguments, Kept(ctypes.byref(self._as_parameter_), self))

    def __reduce_ex__(self, _protocol: Any) -> Any:
        raise TypeError(f"a {type(self).__name__} cannot be pickled or copied")

    def __del__(self) -> None:
        if getattr(self, "_as_parameter_", None):
            if not (_drivers_are_lost and self._kind in _DRIVEN):  # the driver would wait for its threads
                with _Working():
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
def _end() -> None:
    """Waits for the calls of other threads. Removes the log function, because the library may still write log lines
    after the interpreter has ended."""
    global _ended
    try:
        with _idle:
            _ended = True
            while _calls > 0:
                _idle.wait()
    except KeyboardInterrupt:  # the user does not want to wait
        os._exit(130)
    _library.ubs_set_log(LogFunction(0), None)
