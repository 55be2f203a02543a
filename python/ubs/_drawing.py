# SPDX-License-Identifier: Apache-2.0
"""Common code of ubs.torch and ubs.jax: a model whose values, and number of splats, are replaced before each
rendering."""

from __future__ import annotations

import threading
from typing import Any, Sequence

import numpy as np

from ._data import Camera, FloatArray, floats
from ._device import DeviceLike, opened
from ._errors import UsageError
from ._model import Image, Model, Renderer


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
        if self.kept is not camera or not same:
            self.put(arrays)
            self.renderer.draw(camera, for_gradient=True)
        self.kept = None
        return self.renderer.vjp(None, *v_pictures)[0]
