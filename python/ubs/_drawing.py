# SPDX-License-Identifier: Apache-2.0
"""Common code of ubs.torch and ubs.jax: a model whose values, and number of splats, are replaced before each
rendering, and cameras whose values are replaced by arrays that get gradients."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any, Sequence

import numpy as np

from ._data import Camera, FloatArray, floats
from ._device import DeviceLike, opened
from ._errors import UsageError
from ._model import CameraGradient, Image, Model, Renderer


# The singular values of the rotation matrix of a pose must differ from 1 by less than this value. Other matrices are
# probably wrong.
MOST_STRETCH = 0.1
# The shapes of the arrays that replace values of a camera
VIEW_SHAPES: dict[str, tuple[tuple[int, ...], ...]] = {
    "pose": ((3, 4), (4, 4)), "intrinsics": ((4,), (3, 3)), "time": ((), (1,))
}


def check_view_shape(what: str, shape: tuple[int, ...]) -> None:
    if shape not in VIEW_SHAPES[what]:
        raise UsageError(f"{what} has the shape {shape}, not {' or '.join(map(str, VIEW_SHAPES[what]))}")


def polar(matrix: Any) -> tuple[Any, Any]:
    """Decomposes a matrix (3, 3) into a symmetric matrix S and the nearest rotation Q, with S Q = matrix. If the matrix
    is a rotation up to rounding, or is far from a rotation, S is the identity and Q is the unchanged matrix."""
    u, stretch, vt = np.linalg.svd(matrix)
    error = np.abs(stretch - 1).max()
    if not 1e-6 < error < MOST_STRETCH or np.linalg.det(u @ vt) < 0:
        return np.eye(3), matrix
    return u @ np.diag(stretch) @ u.T, u @ vt


def seen(camera: Camera, pose: Any, intrinsics: Any, time: Any) -> Camera:
    """Returns the camera with other values: a pose, intrinsics and a time as float64 arrays, or None for each."""
    if pose is not None:
        matrix = pose.copy()
        matrix[:3, :3] = polar(matrix[:3, :3])[1]
        camera = replace(camera, world_to_camera=matrix)
    if intrinsics is not None:
        other = Camera.from_matrix(camera.world_to_camera, intrinsics, camera.width, camera.height, camera.time)
        camera = replace(other, extra=camera.extra)
    return camera if time is None else camera.at(float(time.reshape(())))


def _v_pose(pose: Any, gradient: CameraGradient) -> Any:
    """Returns the gradient with respect to the matrix M of a pose. M = S Q, where Q is the nearest rotation, and the
    image was rendered with Q. A change dM changes Q by dQ = [w] Q with (tr(S) - S) w = axial(dM Q^T - Q dM^T)."""
    stretch, rotation = polar(pose[:3, :3])
    v = np.zeros(pose.shape)
    v[:3] = gradient.world_to_camera
    x = v[:3, :3] @ rotation.T
    v_w = np.array([x[2, 1] - x[1, 2], x[0, 2] - x[2, 0], x[1, 0] - x[0, 1]])
    if not np.array_equal(stretch, np.eye(3)):
        a, b, c = np.linalg.solve(np.trace(stretch) * np.eye(3) - stretch, v_w)
        v[:3, :3] = np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]]) @ rotation
    return v


def v_view(view: Sequence[Any], gradient: CameraGradient) -> list[Any]:
    """Returns the gradients with respect to `view`, the pose, the intrinsics and the time that seen() has got. They are
    None where these are None."""
    pose, intrinsics, time = view
    found: list[Any] = [None, None, None]
    if pose is not None:
        found[0] = _v_pose(pose, gradient)
    if intrinsics is not None:
        fx, fy, cx, cy = gradient.intrinsics
        matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 0]])
        found[1] = gradient.intrinsics if intrinsics.shape == (4,) else matrix
    if time is not None:
        found[2] = np.full(time.shape, gradient.time)
    return found


class Drawing:
    """Renders a model with values that are replaced before each call. `settings` are those of Renderer."""

    def __init__(self, model: Model, device: DeviceLike, depth: bool, settings: dict[str, Any] | None = None) -> None:
        self.model = model.copy()
        self.device, self.depth, self.settings = opened(device), depth, settings or {}
        self.names = list(self.model.parameters)
        # Must be held while values are set and an image is rendered from them, because several threads may do this.
        self.lock = threading.RLock()
        # Identifies the last image: the argument `reason` of _draw() in ubs.torch, or the camera that was passed to
        # draw(). None if the device no longer has the data from which the gradient of this image is computed.
        self.kept: object = None
        self._make()

    def _make(self) -> None:
        self.values = self.model.parameters
        self.renderer = Renderer(self.model, self.device, depth=self.depth, gradients=True, **self.settings)
        # The device as DLPack describes it (type and number), or None if other packages cannot access its memory.
        self.place: tuple[int, int] | None = None
        try:
            self.place = self.renderer.array("parameters").__dlpack_device__()
        except UsageError:
            pass

    def __reduce__(self) -> Any:
        return Drawing, (self.model, self.device, self.depth, self.settings)

    def resize(self, shapes: Sequence[Sequence[int]]) -> None:
        """Changes the number of splats so that parameters with these shapes fit. The shapes are in the order of
        self.names. Raises UsageError if they have different numbers of splats or wrong widths."""
        self.kept = None
        splats = shapes[0][0] if len(shapes[0]) == 2 else -1
        for name, shape in zip(self.names, shapes):
            width = self.values[name].shape[1]
            if len(shape) != 2 or shape[1] != width:
                raise UsageError(f"{name} has the shape {tuple(shape)}, but must have the shape (splats, {width})")
            if shape[0] != splats:
                raise UsageError(f"{name} has {shape[0]} splats, but {self.names[0]} has {splats}")
        if splats == len(self.model):
            return
        if splats <= self.renderer.capacity:
            self.model = self.model.like(splats)
            self.values = self.model.parameters
            self.renderer.update(self.model)
        else:
            self.model = self.model.like(splats * 5 // 4)
            self._make()
            self.resize(shapes)

    def put(self, arrays: Sequence[FloatArray]) -> None:
        self.resize([array.shape for array in arrays])
        for name, array in zip(self.names, arrays):
            self.values[name] = floats(array, self.values[name].shape, name)
        self.renderer.update(self.model)

    def draw(self, camera: Camera, arrays: Sequence[FloatArray], for_gradient: bool = False) -> Image:
        self.put(arrays)
        image = self.renderer.render(camera, for_gradient=for_gradient)
        self.kept = camera if for_gradient else None
        return image

    def differentiate(
        self, camera: Camera, arrays: Sequence[FloatArray], v_pictures: Sequence[FloatArray]
    ) -> dict[str, FloatArray]:
        """Returns the gradients of the parameters. If the last call was draw() with for_gradient=True, the same camera
        and the same values, uses the data that the device still has of this image. Otherwise renders it again first."""
        same = all(np.array_equal(self.values[name], array) for name, array in zip(self.names, arrays))
        if self.kept != camera or not same:
            self.put(arrays)
            self.renderer.draw(camera, for_gradient=True)
        self.kept = None
        return self.renderer.vjp(None, *v_pictures)[0]
