# SPDX-License-Identifier: Apache-2.0
"""Defines models and renderers, and the functions that compute gradients."""

from __future__ import annotations

import base64
import ctypes
import html
import os
import tempfile
import threading
import weakref
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Iterator, Mapping

import numpy as np
import numpy.typing as npt

from . import _abi
from ._data import Camera, Dataset, FloatArray, c_pointer, check_range, checked_camera, floats
from ._device import Device, DeviceLike, opened
from ._dlpack import DeviceArray
from ._errors import Error, UsageError
from ._falloff import Falloff, as_falloff
from ._png import png
from ._settings import Settings

PIXEL_GRADIENTS = "v_rgb", "v_alpha", "v_depth"  # names of arrays and of arguments of Renderer.vjp()


@dataclass(frozen=True, eq=False)
class Image:
    """A rendered view."""

    rgb: FloatArray
    """The colours (H, W, 3). They are not clamped to the range from 0 to 1."""
    alpha: FloatArray
    """The opacity of each pixel (H, W), from 0 to 1."""
    depth: FloatArray | None
    """The expected depth of each pixel (H, W) in units of the world, or None if it was not requested."""

    def _repr_png_(self) -> bytes:
        """The colours, for notebooks."""
        return png(self.rgb)


@dataclass(frozen=True, eq=False)
class CameraGradient:
    """The gradient with respect to a camera. It only considers changes of the camera after which its rotation matrix is
    still a rotation."""

    pose: npt.NDArray[np.float64]
    """The gradient (6,) with respect to a motion in the coordinate system of the camera. The first three values belong
    to rotations w about the axes of the camera [1/rad], and the last three values to translations u along these axes.
    The motion changes the pose (R, t) to (exp([w]) R, exp([w]) t + u)."""
    world_to_camera: npt.NDArray[np.float64]
    """The gradient (3, 4) with respect to the matrix, with the same restriction to rotations."""
    intrinsics: npt.NDArray[np.float64]
    """The gradient (4,) with respect to fx, fy, cx and cy."""
    time: float
    """The gradient with respect to the time."""
    extra: npt.NDArray[np.float64]
    """The gradient (4,) with respect to further query values."""


@dataclass(frozen=True)
class Loss:
    """The training loss of a view: (1 - lambda_dssim) l1 + lambda_dssim (1 - ssim)."""

    loss: float
    l1: float
    ssim: float


class Parameters(Mapping[str, FloatArray]):
    """The raw parameters of a model by name. Assigning an array to a name writes its values into the model."""

    def __init__(self, arrays: dict[str, FloatArray]) -> None:
        self._arrays = arrays

    def __getitem__(self, name: str) -> FloatArray:
        return self._arrays[name]

    def __setitem__(self, name: str, values: npt.ArrayLike) -> None:
        if name not in self._arrays:
            raise UsageError(f"the model has no parameter named '{name}': there are {', '.join(self._arrays)}")
        self._arrays[name][...] = floats(values, self._arrays[name].shape, name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._arrays)

    def __len__(self) -> int:
        return len(self._arrays)

    def __repr__(self) -> str:
        return f"<ubs.Parameters: {', '.join(f'{name} {values.shape}' for name, values in self.items())}>"


class Model(_abi.Handle):
    """Splats in host memory. Models are created by load(), empty(), initial(), copy(), or by training. len() returns
    the number of splats."""

    def __init__(self, maker: str, *arguments: Any) -> None:
        super().__init__("model", maker, *arguments)
        self._renderers: dict[tuple[Device, int], Renderer] = {}
        self._renderers_lock = threading.RLock()  # several threads may ask for the first renderer at the same time
        self._handed_out = False  # True after the caller got parameters, because it may write them at any time

    @staticmethod
    def load(path: os.PathLike[str] | str) -> Model:
        """Loads a model file of any known format, or the model in the folder of a finished run of `ubs train`."""
        return Model("model_load", _abi.path_bytes(path))

    @staticmethod
    def empty(dim: int, splats: int, **settings: Any) -> Model:
        """Returns a model whose raw parameters are all 0. `settings` are those that a model file stores, such as the
        variant of the model and the background."""
        return Model("model_create", Settings({"dim": dim, **settings}, use=_abi.USE_MODEL), splats)

    @staticmethod
    def initial(data: Dataset, **settings: Any) -> Model:
        """Returns the model that a training on the data with these settings starts from."""
        return Model("model_create_initial", data, Settings(settings, use=_abi.USE_TRAINER))

    def copy(self) -> Model:
        """Returns another model with the same values."""
        return Model("model_copy", self)

    def like(self, splats: int) -> Model:
        """Returns a model with `splats` splats, whose raw parameters are all 0. Its dimension, its variant, its offset
        and its settings for rendering are those of this model."""
        return Model("model_create_like", self, splats)

    def __copy__(self) -> Model:
        return self.copy()

    def __deepcopy__(self, _memo: Any) -> Model:
        return self.copy()

    def __reduce_ex__(self, _protocol: Any) -> Any:
        with tempfile.TemporaryDirectory(prefix="ubs-") as folder:
            self.save(Path(folder) / "model.ply")
            return _model_of, ((Path(folder) / "model.ply").read_bytes(),)

    def __repr__(self) -> str:
        return f"<ubs.Model: {len(self)} splats, N = {self.dim}, form {self.form}>"

    def _repr_html_(self) -> str | None:
        """A picture of the splats as seen from outside, with z upwards, for notebooks."""
        if len(self) == 0:
            return None
        try:
            image = self.render(self._camera_outside())
        except Error:  # for example, because there is no device
            return None
        source = base64.b64encode(png(image)).decode()
        return f'<img src="data:image/png;base64,{source}"><br>{html.escape(repr(self))}'

    def _camera_outside(self, side: int = 256) -> Camera:
        points = np.concatenate([group["xyz"] for group in self._values()]) + self.offset
        middle = np.median(points, axis=0)
        radius = float(np.quantile(np.linalg.norm(points - middle, axis=1), 0.8)) or 1.0
        forward = np.array([-1, 1, -0.6]) / np.linalg.norm([-1, 1, -0.6])
        right = np.cross(forward, [0, 0, 1]) / np.linalg.norm(np.cross(forward, [0, 0, 1]))
        rotation = np.stack([right, np.cross(forward, right), forward])
        shift = -rotation @ (middle - 3 * radius * forward)
        matrix = np.concatenate([rotation, shift[:, None]], axis=1)
        return Camera(matrix, side, side, side / 2, side / 2, side, side, extra=(0.0,) * 4)

    def save(self, path: os.PathLike[str] | str, format: str | None = None, time: float = 0.0) -> None:
        """Saves the model. `format` is a name that `ubs convert --to` accepts, for example "spz" or "3dgs". "ubs" saves
        everything; other formats store the model at `time`. If `format` is None, the extension determines the format,
        where .ply means "ubs". Replaces an existing file.

        Most other formats store Gaussians. Unlike `ubs convert`, this function does not fit them to the model,
        so a model of Beta splats with N > 3 loses more quality."""
        _abi.call("model_save", self, _abi.path_bytes(path), (format or "auto").encode(), time)

    def _info(self) -> _abi.ModelInfo:
        info = _abi.ModelInfo()
        _abi.call("model_get_info", self, ctypes.byref(info))
        return info

    @property
    def dim(self) -> int:
        """N, the number of dimensions of a splat. If the splats have different dimensions, this is N of the first
        group."""
        return int(self._info().dim)

    @property
    def form(self) -> str:
        """The variant of the model: "default", or the settings that differ from those of the default variant."""
        return _abi.text(self._info().form)

    @property
    def offset(self) -> npt.NDArray[np.float64]:
        """The offset (3,) that must be added to the positions of splats: world = xyz + offset."""
        return np.array(self._info().offset[:])

    def __len__(self) -> int:
        return int(self._info().splats)

    @property
    def parameters(self) -> Parameters:
        """Raw parameters by name, such as "xyz". They are arrays (splats, values per splat) that share memory with the
        model, so values that are written to them are rendered. If the model has splats of different dimensions, use
        groups."""
        groups = self.groups
        if len(groups) > 1:
            raise UsageError(f"the model has splats of {len(groups)} different dimensions: use groups")
        return groups[0]

    @property
    def groups(self) -> list[Parameters]:
        """A list with the raw parameters of each group, as `parameters` returns them. A group consists of the splats
        with the same number of dimensions."""
        self._handed_out = True
        return [Parameters(group) for group in self._values()]

    def _values(self) -> list[dict[str, FloatArray]]:
        found: list[dict[str, FloatArray]] = []
        for group in range(self._info().groups):
            found.append({})
            for index in range(100):
                p = _abi.Parameter()
                _abi.call("model_get_parameter", self, group, index, ctypes.byref(p))
                if p.name is None:
                    break
                buffer = (ctypes.c_float * (p.rows * p.splats)).from_address(p.values)
                buffer._model = self  # keeps the memory alive
                rows = np.frombuffer(buffer, np.float32).reshape(p.rows, p.splats)
                found[-1][_abi.text(p.name)] = rows.T
        return found

    def renderer(self, device: DeviceLike = None, *, depth: bool = False, gradients: bool = False) -> Renderer:
        """Returns a renderer with the current values of the model. The model keeps this renderer, and returns it again
        when this method is called with the same arguments later."""
        where = opened(device)
        flags = (_abi.RENDER_DEPTH if depth else 0) | (_abi.RENDER_GRADIENTS if gradients else 0)
        key = (where, flags)
        with self._renderers_lock:
            if key not in self._renderers:
                self._renderers[key] = Renderer(self, where, depth=depth, gradients=gradients)
            elif self._handed_out:
                self._renderers[key].update(self)
            return self._renderers[key]

    def render(
        self,
        camera: Camera,
        time: float | None = None,
        device: DeviceLike = None,
        *,
        out: FloatArray | None = None,
        copy: bool = True,
    ) -> FloatArray:
        """Renders a view and returns (H, W, 3), not clamped. `time` replaces that of the camera. `out` is an array
        to render into, which avoids allocating memory for a large image. `copy=False` returns the renderer's own
        memory, whose content is valid until the model renders its next image. This requires a CPU with PoCL; other
        devices raise UsageError."""
        checked_camera(camera)
        with self._renderers_lock:
            renderer = self.renderer(device)
            # If the caller still uses an array of this renderer that has another size, rendering would free the memory
            # of this array. In this case the model creates another renderer.
            if renderer._lends_other(camera.height, camera.width):
                self._renderers = {key: kept for key, kept in self._renderers.items() if kept is not renderer}
                renderer = self.renderer(device)
        if copy or out is not None:
            return renderer._draw(camera, time, alpha=False, out=out).rgb
        renderer.draw(camera if time is None else camera.at(time))
        return renderer.array("rgb").seen()


_checked: weakref.WeakKeyDictionary[Device, set[Any]] = weakref.WeakKeyDictionary()
_checked_lock = threading.Lock()


def _check_falloff(falloff: Falloff, device: Device, raster: str) -> None:
    """Compares a falloff with float64 before it is first used with this device and rasteriser."""

    def renderer_of(model: Model) -> Renderer:
        renderer = Renderer.__new__(Renderer)
        renderer.device = device
        renderer._create(model, False, True, False, falloff, {"raster": raster})
        return renderer

    def model_of(splats: int) -> Model:
        return Model.empty(dim=3, splats=splats, cov_param="cholesky", eps2d=0, near_plane=1e-6, far_plane=1e30,
                           background=(0, 0, 0))

    with _checked_lock:
        done = _checked.setdefault(device, set())
        if (falloff, raster) not in done:
            falloff.check(renderer_of, model_of, repr(device))
            done.add((falloff, raster))


def _model_of(file: bytes) -> Model:
    with tempfile.TemporaryDirectory(prefix="ubs-") as folder:
        (Path(folder) / "model.ply").write_bytes(file)
        return Model.load(Path(folder) / "model.ply")


class Renderer(_abi.Handle):
    """Holds a copy of a model on a device, and renders it. `settings` are settings for rendering, such as background.
    All other settings have the values that are stored in the model.

    With `gradients`, the renderer can compute gradients. They include the path through the view direction to the
    positions of splats. `ubs train` and the published method ignore this path. The setting query_grad=False ignores it
    here, too.

    With `absgrad`, which requires `gradients`, vjp() and loss() replace the gradient with respect to the position of a
    splat in the image: they sum the absolute values of the contributions of pixels, for x and y separately. The
    gradients of "xyz" are computed from these sums, which are a criterion for densification.

    `falloff` is a ubs.Falloff, or a text with its expression. It replaces the kernel beta by another function that
    describes how the opacity of splats decreases with the distance from their centre. Model files do not record the
    falloff."""

    def __init__(
        self,
        model: Model,
        device: DeviceLike = None,
        *,
        depth: bool = False,
        gradients: bool = False,
        absgrad: bool = False,
        falloff: Falloff | str | None = None,
        **settings: Any,
    ) -> None:
        self.device: Device = opened(device)
        if falloff is not None:
            falloff = as_falloff(falloff)
            _check_falloff(falloff, self.device, settings.get("raster", "auto"))
        self._create(model, depth, gradients, absgrad, falloff, settings)

    def _create(
        self, model: Model, depth: bool, gradients: bool, absgrad: bool, falloff: Falloff | None, settings: dict[str, Any],
        gaussians: bool = False,
    ) -> None:
        self.capacity = len(model)  # maximum number of splats of a model that is passed to update()
        self._depth = depth
        self._like: Model | None = model.copy() if gradients else None  # receives gradients; not visible to the caller
        flags = (_abi.RENDER_DEPTH if depth else 0) | (_abi.RENDER_GRADIENTS if gradients else 0)
        flags |= (_abi.RENDER_ABSGRAD if absgrad else 0) | (_abi.RENDER_GAUSSIANS if gaussians else 0)
        chosen: Any = None
        if settings:
            chosen = Settings.__new__(Settings)
            _abi.Handle.__init__(chosen, "settings", "model_get_settings", model)
            for key, value in settings.items():
                chosen.set(key, value)
            _abi.call("settings_check", chosen, _abi.USE_RENDERER)
        self._pixel_gradients: dict[str, int] = {}  # addresses of the last arrays of PIXEL_GRADIENTS that were returned
        self._kept_size = 0, 0  # size of the last image that was rendered for a gradient
        self._lent: list[weakref.ref[DeviceArray]] = []  # arrays of images that were returned
        # Held during the calls of the library that belong together, so that other threads cannot interrupt them.
        self._lock = threading.RLock()
        own = None if falloff is None else ctypes.byref(falloff.to_c())
        super().__init__("renderer", "renderer_create_falloff", self.device, model, chosen, flags, own)

    def __repr__(self) -> str:
        return f"<ubs.Renderer of at most {self.capacity} splats on {self.device!r}>"

    def update(self, model: Model) -> None:
        """Replaces the parameter values by those of `model`, which must have the same variant and dimensions as the
        model that the renderer was created with, and in each group at most as many splats."""
        _abi.call("renderer_update", self, model)
        if self._like is not None and len(self._like) != len(model):
            self._like = model.copy()

    def _lends_other(self, height: int, width: int) -> bool:
        """Returns whether the caller still holds an array of an image of another size."""
        self._lent = [lent for lent in self._lent if lent() is not None]
        held = (lent() for lent in self._lent)
        return any(array is not None and array.shape[:2] != (height, width) for array in held)

    def _take_size(self, height: int, width: int) -> None:
        if self._lends_other(height, width):
            raise UsageError(
                f"rendering {width}x{height} pixels would free the memory of an array that is still in use and has "
                f"another image size: delete that array (copy it first if you need it), or use another renderer"
            )

    def render(self, camera: Camera, time: float | None = None, *, for_gradient: bool = False) -> Image:
        """Renders a view and returns its image. With `for_gradient`, vjp(None, ...) can differentiate this image
        without rendering it again."""
        return self._draw(camera, time, for_gradient=for_gradient)

    def _draw(
        self,
        camera: Camera,
        time: float | None,
        alpha: bool = True,
        out: FloatArray | None = None,
        for_gradient: bool = False,
    ) -> Image:
        checked_camera(camera)
        c = (camera if time is None else camera.at(time)).to_c()
        size = (max(camera.height, 0), max(camera.width, 0))
        if out is not None and not (
            isinstance(out, np.ndarray) and out.dtype == np.float32 and out.shape == (*size, 3)
            and out.flags.c_contiguous and out.flags.writeable
        ):
            raise UsageError(f"out must be a writable, tightly packed array of float32 with the shape {(*size, 3)}")
        if size[0] * size[1] > 2**26:  # the library may reject this size, so ask it before allocating about 1 GiB
            _abi.call("renderer_draw", self, ctypes.byref(c), ctypes.byref(_abi.Image()))
        rgb = np.empty((*size, 3), np.float32) if out is None else out
        weight = np.empty(size if alpha else 0, np.float32)
        depth = np.empty(size, np.float32) if self._depth else None
        wanted = c_pointer(weight) if alpha else None
        image = _abi.Image(rgb=c_pointer(rgb), alpha=wanted, depth=c_pointer(depth), for_gradient=bool(for_gradient))
        with self._lock:
            self._take_size(*size)
            _abi.call("renderer_draw", self, ctypes.byref(c), ctypes.byref(image))
            self._kept_size = size
        return Image(rgb, weight, depth)

    def draw(self, camera: Camera, *, for_gradient: bool = False) -> None:
        """Renders a view and keeps it on the device, where array() gives access to it. With `for_gradient`,
        vjp(None, ...) can differentiate this image without rendering it again."""
        image = _abi.Image(for_gradient=bool(for_gradient))
        checked_camera(camera)
        with self._lock:
            self._take_size(camera.height, camera.width)
            _abi.call("renderer_draw", self, ctypes.byref(camera.to_c()), ctypes.byref(image))
            self._kept_size = camera.height, camera.width

    def array(self, name: str, group: int = 0, *, size: tuple[int, int] = (0, 0)) -> DeviceArray:
        """Returns an array in the memory of the device, for torch.from_dlpack and similar functions (on a CPU also
        np.asarray). Available on CUDA devices and on CPUs with PoCL; other devices raise UsageError.

        - "parameters" (rows, splats), in the order of Model.parameters; may be written
        - of the last rendered image: "rgb" (H, W, 3), but not after vjp() of alpha or depth; "transmittance" (H, W),
          which is 1 - alpha; and "depth" (H, W)
        - "v_rgb", "v_alpha" and "v_depth": zeros of `size`, (H, W, 3) or (H, W), to be written and passed to vjp()
        - "gradient" (rows, splats), after vjp() or loss()
        - "extents" (splats, 2): half the width and height [px] of the rectangle around each splat in the last image;
          undefined for splats that are not between the near and the far plane
        - "means2d" (splats, 2): the position of each splat in the last image [px]; the positions of splats that are not
          between these planes are computed with the depth 1. "depths" (splats): their depths. "opacities" (splats): the
          opacities with which they are rendered; undefined where "extents" are
        - "v_means2d" (splats, 2), after vjp() or loss(): the gradient with respect to the position of each splat in the
          image [1/px], or the sums of `absgrad`; may be written, and "gradient" is then computed from the written
          values

        When this function returns, the library has finished using the array. The caller must finish using it, including
        work in streams, before the next call that uses this device. The array is valid until update(), or until a view
        of another size is rendered. While an array of pixels is in use, a view of another size raises UsageError."""
        if name not in _abi.ARRAYS:
            raise UsageError(f"there is no array '{name}': choose one of {', '.join(_abi.ARRAYS)}")
        if not all(0 <= n < 2**31 for n in size):
            raise UsageError(f"size {size} is not supported: pass two whole numbers below 2^31")
        if name in PIXEL_GRADIENTS and 0 in size:
            raise UsageError(f'array("{name}") needs the size of the view: size=(height, width)')
        array = _abi.Array()
        array.shape[:2] = size
        with self._lock:
            if name in PIXEL_GRADIENTS:
                self._take_size(*size)
            _abi.call("renderer_get_array", self, _abi.ARRAYS.index(name), group, ctypes.byref(array))
            found = DeviceArray(self, array)
            if name in PIXEL_GRADIENTS:
                self._pixel_gradients[name] = found.address
            if name not in ("parameters", "gradient", "extents", "v_means2d", "means2d", "depths", "opacities"):
                self._lent.append(weakref.ref(found))
        return found

    def _gradients(self) -> Model:
        if self._like is None:
            raise UsageError("the renderer was created without gradients=True")
        return self._like

    def vjp(
        self,
        camera: Camera | None,
        v_rgb: npt.ArrayLike | DeviceArray | None = None,
        v_alpha: npt.ArrayLike | DeviceArray | None = None,
        v_depth: npt.ArrayLike | DeviceArray | None = None,
        *,
        parameters: bool = True,
        more: tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike] | None = None,
    ) -> list[dict[str, FloatArray]]:
        """Computes the vector-Jacobian product of rendering, as ubs.vjp() does. Returns a list with one dictionary per
        group. With `parameters=False` the list is empty, for callers that only need camera_gradient() or
        array("gradient"). The gradients of pixels may be those of array("v_rgb"), array("v_alpha") and
        array("v_depth").

        If `camera` is None, this method differentiates the image of the last draw() or render() with for_gradient=True,
        or of the last vjp(camera), without rendering it again. In this case, it raises UsageError if the parameters
        have been replaced or requested since that call, or if gradients of alpha or depth have been computed.

        more: three arrays that describe further channels of the scene, for renderers with absgrad=True, which sum a
        contribution over all channels before they take its absolute value: the gradient (H, W, K), these channels of
        the image (H, W, K) without a background, and the values of the splats (splats, K). The result contains no
        gradient with respect to these values."""
        into = self._gradients()
        if camera is None and self._kept_size == (0, 0):
            raise UsageError("there is no image to differentiate: render with for_gradient=True, or pass the camera")
        size = self._kept_size if camera is None else (checked_camera(camera).height, camera.width)
        given: list[FloatArray] = []  # those in host memory, which must exist until the library has read them
        v = _abi.ImageGradient()
        for name, values, channels in zip(PIXEL_GRADIENTS, (v_rgb, v_alpha, v_depth), ((3,), (), ())):
            if isinstance(values, DeviceArray):
                # The library would treat any other address as host memory.
                if values.address != self._pixel_gradients.get(name):
                    raise UsageError(f'{name} is a device array, but not the last array("{name}") of this renderer')
                setattr(v, name[2:], values.address)
            elif values is not None:
                given.append(floats(values, (*size, *channels), name))
                setattr(v, name[2:], c_pointer(given[-1]))
        if more is not None:
            if len(more) != 3 or np.ndim(more[0]) != 3:
                raise UsageError("more must contain three arrays, the first of them (H, W, channels)")
            v.more_channels = np.shape(more[0])[-1]
            rows = sum(len(group["xyz"]) for group in into._values())
            for name, values, shape in zip(("more", "more_image", "more_colours"), more, (size, size, (rows,))):
                given.append(floats(values, (*shape, v.more_channels), name))
                setattr(v, name, c_pointer(given[-1]))
        with self._lock:
            self._take_size(*size)
            seen = None if camera is None else ctypes.byref(camera.to_c())
            _abi.call("renderer_vjp", self, seen, ctypes.byref(v), into if parameters else None)
            self._kept_size = size
            return _copied(into) if parameters else []

    def camera_gradient(self) -> CameraGradient:
        """Returns the gradient with respect to the camera for the last call of vjp() or loss(). It includes the effect
        of the view direction on the splats, for every value of query_grad. Raises UsageError if the background is a
        sky, or if the renderer was created with absgrad=True."""
        g = _abi.CameraGradient()
        _abi.call("renderer_camera_gradient", self, ctypes.byref(g))
        return CameraGradient(
            pose=np.array(g.pose[:]),
            world_to_camera=np.array(g.world_to_camera[:]).reshape(3, 4),
            intrinsics=np.array([g.fx, g.fy, g.cx, g.cy]),
            time=float(g.time),
            extra=np.array(g.extra[:]),
        )

    def loss(
        self,
        camera: Camera,
        target: npt.ArrayLike,
        lambda_dssim: float = 0.2,
        mask: npt.ArrayLike | None = None,
        gradients: bool = True,
    ) -> tuple[Loss, list[dict[str, FloatArray]]]:
        """Computes the training loss of a view, as ubs.loss() does. Returns the loss, and a list with one dictionary of
        gradients per group. With gradients=False, the list is empty."""
        into = self._gradients() if gradients else None
        size = (checked_camera(camera).height, camera.width)
        wanted = floats(as_float(target), (*size, 3), "target")
        counts = None if mask is None else np.ascontiguousarray(np.asarray(mask) != 0, dtype=np.uint8)
        if counts is not None and counts.shape != size:
            raise UsageError(f"mask has the shape {counts.shape}, not {size}")
        out = _abi.Loss()
        with self._lock:
            self._take_size(*size)
            _abi.call(
                "renderer_loss",
                self,
                ctypes.byref(camera.to_c()),
                c_pointer(wanted),
                c_pointer(counts),
                lambda_dssim,
                ctypes.byref(out),
                into,
            )
            return Loss(out.loss, out.l1, out.ssim), [] if into is None else _copied(into)


def as_float(image: npt.ArrayLike) -> npt.NDArray[Any]:
    """Converts uint8 to float, with values that are bit-identical to those of the library. Does not change
    floating-point values."""
    array = np.asarray(image)
    if array.dtype == np.uint8:
        return array.astype(np.float32) / np.float32(255)
    if not np.issubdtype(array.dtype, np.floating):
        raise UsageError(f"an image has the type {array.dtype}: pass uint8, or floating point from 0 to 1")
    check_range(array, "an image")
    return array


def _copied(gradient: Model) -> list[dict[str, FloatArray]]:
    return [{name: values.copy() for name, values in group.items()} for group in gradient._values()]


def _only(groups: list[dict[str, FloatArray]]) -> dict[str, FloatArray]:
    if len(groups) > 1:
        raise UsageError(
            f"the model has splats of {len(groups)} different dimensions: use Renderer.vjp() or Renderer.loss()"
        )
    return groups[0]


def vjp(
    model: Model,
    camera: Camera,
    v_rgb: npt.ArrayLike | None = None,
    v_alpha: npt.ArrayLike | None = None,
    device: DeviceLike = None,
    *,
    v_depth: npt.ArrayLike | None = None,
) -> dict[str, FloatArray]:
    """Returns the vector-Jacobian product of rendering. Converts the gradient of a scalar with respect to the pixels,
    v_rgb (H, W, 3), v_alpha (H, W) and v_depth (H, W), to the gradient of this scalar with respect to every raw
    parameter. The result has the names and shapes of model.parameters.

    The gradient includes the path through the view direction, because the rendered image depends on it. `ubs train` and
    the published method ignore this path. Renderer(model, gradients=True, query_grad=False).vjp() ignores it, too.
    Renderer.camera_gradient() returns the gradient with respect to the camera."""
    renderer = model.renderer(device, depth=v_depth is not None, gradients=True)
    return _only(renderer.vjp(camera, v_rgb, v_alpha, v_depth))


def loss(
    model: Model,
    camera: Camera,
    target: npt.ArrayLike,
    lambda_dssim: float = 0.2,
    mask: npt.ArrayLike | None = None,
    device: DeviceLike = None,
) -> tuple[Loss, dict[str, FloatArray]]:
    """Returns the training loss of one view, without regularisers, and its gradient, with the names and shapes of
    model.parameters. target: the photograph (H, W, 3), uint8 or floating point from 0 to 1. mask: (H, W); pixels with
    the value 0 are ignored.

    The gradient includes the path through the view direction, as that of vjp() does. Training ignores this path."""
    found, gradient = model.renderer(device, gradients=True).loss(camera, target, lambda_dssim, mask)
    return found, _only(gradient)
