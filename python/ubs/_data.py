# SPDX-License-Identifier: Apache-2.0
"""Defines the classes of cameras, views and data sets."""

from __future__ import annotations

import ctypes
import os
import tempfile
from dataclasses import dataclass, field, replace
from typing import Any, Callable, Iterator, Sequence

import numpy as np
import numpy.typing as npt

from . import _abi
from ._errors import DataError, UsageError
from ._png import png
from ._settings import Settings

FloatArray = npt.NDArray[np.float32]
ByteArray = npt.NDArray[np.uint8]


def c_pointer(array: npt.NDArray[Any] | None) -> int | None:
    # array.ctypes would import a module, which is not possible while the interpreter ends.
    return None if array is None else int(array.__array_interface__["data"][0])


def floats(values: npt.ArrayLike, shape: tuple[int, ...], what: str) -> FloatArray:
    """Returns the values as a contiguous float32 array. Raises UsageError if they do not have this shape."""
    array = np.ascontiguousarray(values, dtype=np.float32)
    if array.shape != shape:
        raise UsageError(f"{what} has the shape {array.shape}, not {shape}")
    return array


def check_range(array: npt.NDArray[Any], what: str) -> None:
    """Raises UsageError if floating-point values apparently have another range than 0 to 1, such as 0 to 255. Values
    from -1 to 2 are accepted, because rendered images may contain values outside of 0 to 1."""
    if array.size and (array.min() < -1 or array.max() > 2):
        raise UsageError(
            f"{what} has values from {array.min():.4g} to {array.max():.4g}: pass uint8, or floating point from 0 to 1"
        )


def image_bytes(image: npt.ArrayLike, shape: tuple[int, ...], what: str) -> ByteArray:
    """Returns an image as uint8. uint8 values are kept; floating-point values from 0 to 1 are clamped and rounded."""
    array = np.asarray(image)
    if array.shape != shape:
        raise UsageError(f"{what} has the shape {array.shape}, not {shape}")
    if array.dtype != np.uint8:
        if not np.issubdtype(array.dtype, np.floating):
            raise UsageError(f"{what} has the type {array.dtype}: pass uint8, or floating point from 0 to 1")
        if not np.isfinite(array).all():
            raise UsageError(f"{what} has values that are not finite")
        check_range(array, what)
        array = np.rint(np.clip(array, 0, 1) * 255).astype(np.uint8)
    return np.ascontiguousarray(array)


def checked_camera(given: Any) -> Camera:
    """Returns the argument if it is a Camera."""
    if not isinstance(given, Camera):
        hint = ": pass its camera" if isinstance(getattr(given, "camera", None), Camera) else ""
        raise UsageError(f"a camera must be a ubs.Camera, not {type(given).__name__}{hint}")
    return given


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera with COLMAP's axes: x right, y down, z forward. Cameras are equal if all their numbers are
    equal.

    world_to_camera: (3, 4), rotation and translation. fx, fy, cx, cy, width, height: in pixels; the centre of the first
    pixel is (0.5, 0.5). time: 0 to 1, for models with time. extra: further query values, for N = 5 and N >= 8."""

    world_to_camera: npt.NDArray[np.float64]
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    time: float = 0.0
    extra: tuple[float, ...] = field(default=())

    def _numbers(self) -> tuple[Any, ...]:
        matrix = np.asarray(self.world_to_camera, dtype=np.float64)[:3]
        optics = (self.fx, self.fy, self.cx, self.cy, self.width, self.height, self.time)
        return (matrix.shape, *matrix.ravel().tolist(), *optics, *self.extra)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Camera):
            return NotImplemented
        return self._numbers() == other._numbers()

    def __hash__(self) -> int:
        return hash(self._numbers())

    @staticmethod
    def from_matrix(
        world_to_camera: npt.ArrayLike, intrinsics: npt.ArrayLike, width: int, height: int, time: float = 0.0
    ) -> Camera:
        """Makes a camera. world_to_camera: (3, 4), or (4, 4) with the last row 0 0 0 1. intrinsics: (fx, fy, cx, cy),
        or the matrix (3, 3), without skew and with the last row 0 0 1. Raises UsageError for other intrinsics. A wrong
        world_to_camera raises UsageError when the camera is used."""
        k = np.asarray(intrinsics, dtype=np.float64)
        if k.shape == (3, 3):
            if np.abs(k[0, 1]) > 1e-6 * np.abs(k[0, 0]) or k[1, 0] != 0:
                raise UsageError(f"intrinsics have the skew {k[0, 1] or k[1, 0]:g}, which ubs does not support")
            if not np.array_equal(k[2], (0, 0, 1)):
                raise UsageError(f"the last row of the intrinsics is {k[2]}, not 0 0 1")
            k = np.array([k[0, 0], k[1, 1], k[0, 2], k[1, 2]])
        if k.shape != (4,):
            raise UsageError(f"intrinsics have the shape {k.shape}, not (3, 3) or (4,)")
        fx, fy, cx, cy = (float(v) for v in k)
        return Camera(np.asarray(world_to_camera, dtype=np.float64), fx, fy, cx, cy, width, height, time)

    def at(self, time: float) -> Camera:
        """Returns the same camera at another time."""
        return replace(self, time=time)

    def to_c(self) -> _abi.Camera:
        matrix = np.ascontiguousarray(self.world_to_camera, dtype=np.float64)
        if matrix.shape == (4, 4):
            if not np.array_equal(matrix[3], (0, 0, 0, 1)):
                raise UsageError(f"the last row of world_to_camera is {matrix[3]}, not 0 0 0 1")
            matrix = np.ascontiguousarray(matrix[:3])
        if matrix.shape != (3, 4):
            raise UsageError(f"world_to_camera has the shape {matrix.shape}, not (3, 4)")
        c = _abi.Camera(fx=self.fx, fy=self.fy, cx=self.cx, cy=self.cy, time=self.time)
        width, height = (_abi.integer(getattr(self, name), f"the camera: {name}") for name in ("width", "height"))
        if max(abs(width), abs(height)) >= 2**31:  # ctypes would only pass the lower bits
            raise UsageError(f"the camera: the image size {width}x{height} is not possible")
        c.width, c.height = width, height
        c.world_to_camera[:] = [float(v) for v in matrix.ravel()]
        if len(self.extra) > 4:
            raise UsageError(f"a camera has at most 4 further query values, not {len(self.extra)}")
        c.extra_count = len(self.extra)
        for index, value in enumerate(self.extra):
            c.extra[index] = value
        return c

    @staticmethod
    def from_c(c: _abi.Camera) -> Camera:
        return Camera(
            np.array(c.world_to_camera[:]).reshape(3, 4),
            c.fx,
            c.fy,
            c.cx,
            c.cy,
            c.width,
            c.height,
            c.time,
            tuple(c.extra[: c.extra_count]),
        )


@dataclass(frozen=True, eq=False)
class _Pixels:
    """The image and the mask of an unpickled view, or None for each."""

    rgb: ByteArray | None
    mask: ByteArray | None


@dataclass(frozen=True)
class View:
    """A view of a data set: its name, its camera, and its image and mask if they exist. A pickled view contains its
    image and its mask, so processes that get it need not open the data set."""

    name: str
    camera: Camera
    has_image: bool
    has_mask: bool
    _data: Dataset | _Pixels = field(repr=False)
    _split: str = field(repr=False)
    _index: int = field(repr=False)

    @property
    def image(self) -> ByteArray:
        """The image (H, W, 3) as uint8. Each access decodes the image, unless the data set keeps it in memory."""
        return self._load()[0]

    @property
    def mask(self) -> ByteArray:
        """The mask (H, W) as uint8. Pixels with the value 0 are ignored. If the view has no mask, all values are
        255."""
        return self._load()[1]

    def _load(self) -> tuple[ByteArray, ByteArray]:
        size = (self.camera.height, self.camera.width)
        if isinstance(self._data, _Pixels):
            if self._data.rgb is None:
                raise DataError(f"view '{self.name}' has no image")
            kept = self._data.mask
            return self._data.rgb.copy(), np.full(size, 255, np.uint8) if kept is None else kept.copy()
        rgb, mask = np.empty((*size, 3), np.uint8), np.empty(size, np.uint8)
        _abi.call(
            "data_get_image",
            self._data,
            self._split.encode(),
            self._index,
            c_pointer(rgb),
            c_pointer(mask),
        )
        return rgb, mask

    def __reduce_ex__(self, _protocol: Any) -> Any:
        rgb, mask = self._load() if self.has_image else (None, None)
        pixels = _Pixels(rgb, mask if self.has_mask else None)
        return View, (self.name, self.camera, self.has_image, self.has_mask, pixels, self._split, self._index)

    def __copy__(self) -> View:
        return self  # cannot be changed

    def __deepcopy__(self, _memo: Any) -> View:
        return self

    def _repr_png_(self) -> bytes | None:
        """The image, for notebooks."""
        return png(self.image) if self.has_image else None


class Dataset(_abi.Handle):
    """A data set: views with cameras and images in the splits "train", "test" and "val". open(), from_arrays() and
    synth() create data sets. len() is the number of all views. An iteration returns the views in the order of these
    splits.

    A copied or unpickled data set opens the same files again, or creates the same synthetic scene again if its files
    were temporary. It has copies of the views and points that were added."""

    SPLITS = ("train", "test", "val")
    # A function that opens or creates the files again, and its arguments
    _source: tuple[Callable[[str, dict[str, Any]], Dataset], str, dict[str, Any]] | None = None
    _temporary: Any = None  # the folder of the files, if it is deleted together with the data set
    _points: tuple[npt.ArrayLike, npt.ArrayLike | None] | None = None

    @classmethod
    def open(cls, path: os.PathLike[str] | str, **settings: Any) -> Dataset:
        """Opens a folder of any layout that ubs supports, or a packed file. `settings` are those that affect how data
        are read, such as background, downscale, layout, test_every and frames."""
        data = cls.__new__(cls)
        given = Settings(settings, use=_abi.USE_DATA)
        _abi.Handle.__init__(data, "data", "data_open", _abi.path_bytes(path), given)
        data._source = (_open, os.path.abspath(path), settings)
        data._opened = {split: len(data.views(split)) for split in cls.SPLITS}
        return data

    def __init__(self) -> None:
        """Creates a data set without views, to be filled with add_view()."""
        super().__init__("data", "data_create")
        self._opened = dict.fromkeys(self.SPLITS, 0)

    def __len__(self) -> int:
        return sum(len(self.views(split)) for split in self.SPLITS)

    def __iter__(self) -> Iterator[View]:
        for split in self.SPLITS:
            yield from self.views(split)

    def __repr__(self) -> str:
        counts = ", ".join(f"{len(views)} {split}" for split in self.SPLITS if (views := self.views(split)))
        where = f" of {self._source[1]!r}" if self._source else ""
        return f"<ubs.Dataset{where}: {counts or 'no'} views>"

    def __reduce_ex__(self, _protocol: Any) -> Any:
        added = [
            (split, view.camera, view.image if view.has_image else None, view.mask if view.has_mask else None, view.name)
            for split in self.SPLITS
            for view in self.views(split)[self._opened[split] :]
        ]
        return _restored, (self._source, added, self._points)

    @classmethod
    def from_arrays(
        cls,
        images: Sequence[npt.ArrayLike] | npt.NDArray[Any],
        world_to_camera: npt.ArrayLike,
        intrinsics: npt.ArrayLike,
        *,
        times: npt.ArrayLike | None = None,
        masks: Sequence[npt.ArrayLike] | npt.NDArray[Any] | None = None,
        points: npt.ArrayLike | None = None,
        colours: npt.ArrayLike | None = None,
        test: Sequence[int] = (),
    ) -> Dataset:
        """Makes a data set of V views from arrays.

        images: V arrays of (H, W, 3), uint8 or floating point from 0 to 1, already composited on their background.
        world_to_camera: (V, 3, 4). intrinsics: (3, 3) or (fx, fy, cx, cy), or V of them. times: (V,), 0 to 1.
        masks: V arrays of (H, W); pixels with the value 0 are ignored. points: (P, 3) and colours: (P, 3) uint8, for
        the initial model. test: the views that are used for evaluation and not for training, as indices or as V
        booleans."""
        count = len(images)
        poses = np.asarray(world_to_camera, dtype=np.float64)
        if poses.ndim != 3 or poses.shape[0] != count:
            raise UsageError(f"world_to_camera has the shape {poses.shape}, not ({count}, 3, 4)")
        k = np.asarray(intrinsics, dtype=np.float64)
        shared = k.shape in ((3, 3), (4,))
        if not shared and k.shape not in ((count, 3, 3), (count, 4)):
            raise UsageError(
                f"intrinsics have the shape {k.shape}, but must be (3, 3) or (4,), or one of these per view"
            )
        moments = np.zeros(count) if times is None else np.asarray(times, dtype=np.float64)
        if moments.shape != (count,):
            raise UsageError(f"times has the shape {moments.shape}, not ({count},)")
        held_out = np.asarray(test)
        if held_out.dtype == bool:
            if held_out.shape != (count,):
                raise UsageError(f"test has {held_out.size} booleans, but there are {count} views")
            held_out = np.flatnonzero(held_out)
        if masks is not None and len(masks) != count:
            raise UsageError(f"there are {len(masks)} masks, but {count} images")
        if colours is not None and points is None:
            raise UsageError("colours require points")
        for number in held_out:
            if number not in range(count):
                raise UsageError(f"test: view {number} does not exist: the views are numbered from 0 to {count - 1}")
        data = cls()
        for i in range(count):
            if len(shape := np.shape(images[i])) != 3:
                raise UsageError(f"image {i} has the shape {shape}, not (H, W, 3)")
            height, width = shape[:2]
            camera = Camera.from_matrix(poses[i], k if shared else k[i], width, height, float(moments[i]))
            data.add_view(
                "test" if i in held_out else "train",
                camera,
                images[i],
                mask=None if masks is None else masks[i],
                name=str(i),
            )
        if points is not None:
            data.set_points(points, colours)
        return data

    def add_view(
        self,
        split: str,
        camera: Camera,
        image: npt.ArrayLike | None = None,
        *,
        mask: npt.ArrayLike | None = None,
        name: str | None = None,
    ) -> None:
        """Appends a view. image: (H, W, 3), uint8 or floating point from 0 to 1. mask: (H, W); pixels with the value 0
        are ignored. name: must be unique in its split; the default is the number of the view."""
        size = (camera.height, camera.width)
        rgb = None if image is None else image_bytes(image, (*size, 3), "the image")
        counts = None
        if mask is not None:
            array = np.asarray(mask)
            if array.shape != size:
                raise UsageError(f"the mask has the shape {array.shape}, not {size}")
            counts = np.ascontiguousarray(np.where(array != 0, 255, 0).astype(np.uint8))
        _abi.call(
            "data_add_view",
            self,
            split.encode(),
            None if name is None else name.encode(),
            ctypes.byref(camera.to_c()),
            c_pointer(rgb),
            c_pointer(counts),
        )

    def set_points(self, points: npt.ArrayLike, colours: npt.ArrayLike | None = None) -> None:
        """Sets the points from which the initial model is made. points: positions (P, 3) in world coordinates. colours:
        (P, 3), uint8 or floating point from 0 to 1."""
        positions = np.ascontiguousarray(points, dtype=np.float32)
        if positions.ndim != 2 or positions.shape[1] != 3:
            raise UsageError(f"points has the shape {positions.shape}, not (P, 3)")
        rgb = None if colours is None else image_bytes(colours, positions.shape, "colours")
        _abi.call("data_set_points", self, len(positions), c_pointer(positions), c_pointer(rgb))
        self._points = (positions, rgb)

    def views(self, split: str) -> list[View]:
        """Returns the views of a split, or an empty list if the data set has no views in this split."""
        count = ctypes.c_size_t()
        _abi.call("data_view_count", self, split.encode(), ctypes.byref(count))
        found = []
        for index in range(count.value):
            view = _abi.View()
            _abi.call("data_get_view", self, split.encode(), index, ctypes.byref(view))
            camera = Camera.from_c(view.camera)
            name = _abi.text(view.name)
            found.append(View(name, camera, bool(view.has_image), bool(view.has_mask), self, split, index))
        return found

    @property
    def train(self) -> list[View]:
        """The training views."""
        return self.views("train")

    @property
    def test(self) -> list[View]:
        """The test views."""
        return self.views("test")


def _open(path: str, settings: dict[str, Any]) -> Dataset:
    return Dataset.open(path, **settings)


def _restored(
    source: tuple[Callable[[str, dict[str, Any]], Dataset], str, dict[str, Any]] | None,
    added: Sequence[tuple[Any, ...]],
    points: Any,
) -> Dataset:
    data = source[0](source[1], source[2]) if source else Dataset()
    for split, camera, image, mask, name in added:
        data.add_view(split, camera, image, mask=mask, name=name)
    if points:
        data.set_points(*points)
    return data


def synth(
    scene: str = "glossy",
    *,
    size: int | tuple[int, int] = 100,
    views: int = 40,
    test_views: int = 8,
    val_views: int = 0,
    supersampling: int = 3,
    seed: int = 0,
    out: os.PathLike[str] | str | None = None,
    overwrite: bool = False,
) -> Dataset:
    """Makes a procedural scene with exact cameras, as `ubs synth` does, and opens it.

    scene: "glossy" (static, with reflections), "orbit" (dynamic) or "cloud" (a volume). size: side of the images in
    pixels, or (width, height). supersampling: rays per pixel along each axis. out: a folder for the files; with None,
    the files are in a temporary folder, which is deleted together with the data set. overwrite: replace an earlier
    scene in `out`. With the default values, the call takes about a second."""
    again = {"size": size, "views": views, "test_views": test_views, "val_views": val_views,
             "supersampling": supersampling, "seed": seed}
    sides: Any = size if np.shape(size) == (2,) else (size, size)
    width, height = sides
    # Each entry contains the name of an argument, its value, and its minimum.
    integers = [("views", views, 1), ("test_views", test_views, 0), ("val_views", val_views, 0), ("width", width, 1),
                ("height", height, 1), ("supersampling", supersampling, 1), ("seed", seed, 0)]
    for name, value, least in integers:
        if _abi.integer(value, f"synth: {name}", least) >= 2**31:
            raise UsageError(f"synth: {name} = {value} is too large")
    temporary = tempfile.TemporaryDirectory(prefix="ubs-") if out is None else None
    folder = temporary.name if temporary else os.fspath(out or "")
    options = _abi.Synthetic(
        scene=scene.encode(), width=width, height=height, train_views=views, test_views=test_views or -1,
        val_views=val_views, supersampling=supersampling, seed=seed, overwrite=bool(overwrite),
    )
    _abi.call("data_synthesise", ctypes.byref(options), _abi.Kept(_abi.path_bytes(folder), temporary))
    data = Dataset.open(folder)
    if temporary:
        data._source, data._temporary = (_synth, scene, again), temporary
    return data


def _synth(scene: str, options: dict[str, Any]) -> Dataset:
    return synth(scene, **options)
