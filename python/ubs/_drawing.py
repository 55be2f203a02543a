# SPDX-License-Identifier: Apache-2.0
"""Common code of ubs.torch and ubs.jax: a model whose values are replaced before each rendering."""

from __future__ import annotations

import threading
from typing import Sequence

from ._data import Camera, FloatArray, floats
from ._device import DeviceLike
from ._errors import UsageError
from ._model import Image, Model, Renderer


class Drawing:
    def __init__(self, model: Model, device: DeviceLike, depth: bool) -> None:
        self.model = model.copy()
        self.values = self.model.parameters
        self.names = list(self.values)
        self.depth = depth
        self.renderer = Renderer(self.model, device, depth=depth, gradients=True)
        # Device in the terms of DLPack, if other packages can access its memory.
        self.place: tuple[int, int] | None = None
        try:
            self.place = self.renderer.array("parameters").__dlpack_device__()
        except UsageError:
            pass
        self.lock = threading.RLock()  # several calls set values and render, possibly from different threads

    def check_shape(self, name: str, shape: Sequence[int]) -> None:
        if tuple(shape) != self.values[name].shape:
            raise UsageError(f"{name} has the shape {tuple(shape)}, not {self.values[name].shape}")

    def put(self, arrays: Sequence[FloatArray]) -> None:
        for name, array in zip(self.names, arrays):
            self.values[name][...] = floats(array, self.values[name].shape, name)
        self.renderer.update(self.model)

    def draw(self, camera: Camera, arrays: Sequence[FloatArray]) -> Image:
        self.put(arrays)
        return self.renderer.render(camera)

    def differentiate(
        self, camera: Camera, arrays: Sequence[FloatArray], v_pictures: Sequence[FloatArray]
    ) -> dict[str, FloatArray]:
        self.put(arrays)  # another image may have been rendered since
        return self.renderer.vjp(camera, *v_pictures)[0]
