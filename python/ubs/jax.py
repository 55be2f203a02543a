# SPDX-License-Identifier: Apache-2.0
"""Provides rendering as a differentiable function of JAX. The function can be used in jax.jit.

    import ubs, ubs.jax
    splats = ubs.jax.Splats(ubs.Model.initial(data, dim=6))
    view = splats.view(camera)                       # a function
    parameters = splats.parameters()                 # {"xyz": (splats, 3), ...}
    jax.grad(lambda p: my_loss(*view(p)))(parameters)

Values are copied through host memory. Only reverse-mode derivatives of first order, with respect to the parameters, are
supported. They include the path through the view direction, because the image depends on it. `ubs train` ignores this
path. With the setting query_grad=False, it is ignored here, too."""

from __future__ import annotations

from typing import Any, Callable

import jax
import jax.numpy as jnp
import numpy as np

from ._data import Camera, FloatArray
from ._device import DeviceLike
from ._drawing import Drawing
from ._model import Model

Parameters = dict[str, Any]


class Splats:
    """Renders a model as a function of its raw parameters. All splats must have the same dimension, but the number of
    splats may differ between calls. With `depth`, the function also returns depth. `settings` are those of
    ubs.Renderer, such as background.

    Gradients include the path through the view direction to the positions of the splats, because the rendered image
    depends on it. `ubs train` and the published method ignore this path. The setting query_grad=False ignores it here,
    too."""

    def __init__(self, model: Model, device: DeviceLike = None, *, depth: bool = False, **settings: Any) -> None:
        self._drawing = Drawing(model, device, depth, settings)
        self._initial = self._drawing.model.copy()
        self._depth = depth

    def parameters(self) -> Parameters:
        """Returns the parameters of the model that this object was created with."""
        return {name: jnp.array(values) for name, values in self._initial.parameters.items()}

    def _arrays(self, parameters: Parameters) -> list[FloatArray]:
        return [np.asarray(parameters[name]) for name in self._drawing.names]

    def view(self, camera: Camera) -> Callable[[Parameters], tuple[Any, ...]]:
        """Returns a function of the parameters that renders this camera. The function returns rgb (H, W, 3), which is
        not clamped, alpha (H, W), and, if the object was created with depth=True, depth (H, W)."""
        size = (camera.height, camera.width)
        shapes = [(*size, 3), size, size][: 3 if self._depth else 2]
        pictures = tuple(jax.ShapeDtypeStruct(shape, np.float32) for shape in shapes)

        # JAX calls these functions from its own threads, so they must hold the lock.
        def draw(parameters: Parameters, for_gradient: bool = False) -> tuple[FloatArray | None, ...]:
            with self._drawing.lock:
                image = self._drawing.draw(camera, self._arrays(parameters), for_gradient)
            return (image.rgb, image.alpha, image.depth)[: len(pictures)]

        def draw_for_gradient(parameters: Parameters) -> tuple[FloatArray | None, ...]:
            return draw(parameters, True)

        def differentiate(parameters: Parameters, v: tuple[Any, ...]) -> dict[str, FloatArray]:
            with self._drawing.lock:
                return self._drawing.differentiate(camera, self._arrays(parameters), [np.asarray(x) for x in v])

        def seen(parameters: Parameters) -> Any:
            return jax.pure_callback(draw, pictures, parameters)

        def forward(parameters: Parameters) -> tuple[Any, Parameters]:
            return jax.pure_callback(draw_for_gradient, pictures, parameters), parameters

        def backward(parameters: Parameters, v: tuple[Any, ...]) -> tuple[Any]:
            like = {name: jax.ShapeDtypeStruct(x.shape, x.dtype) for name, x in parameters.items()}
            return (jax.pure_callback(differentiate, like, parameters, v),)

        function = jax.custom_vjp(seen)
        function.defvjp(forward, backward)
        made: Callable[[Parameters], tuple[Any, ...]] = function
        return made

    def model(self, parameters: Parameters) -> Model:
        """Returns a copy of the model with these values."""
        with self._drawing.lock:
            self._drawing.put(self._arrays(parameters))
            return self._drawing.model.copy()
