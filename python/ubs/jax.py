# SPDX-License-Identifier: Apache-2.0
"""Provides rendering as a differentiable function of JAX. The function can be used in jax.jit and jax.vmap.

    import ubs, ubs.jax
    splats = ubs.jax.Splats(ubs.Model.initial(data, dim=6))
    view = splats.view(camera)                       # a function
    parameters = splats.parameters()                 # {"xyz": (splats, 3), ...}
    jax.grad(lambda p: my_loss(*view(p)))(parameters)
    jax.grad(lambda m: my_loss(*view(parameters, pose=m)))(pose)

Values are copied through host memory. jax.vmap renders one view after the other. Only reverse-mode derivatives of first
order are supported, such as those of jax.grad and jax.vjp: jax.jvp, jax.jacfwd and jax.hessian raise TypeError. The
derivatives are those with respect to the parameters, and to the values of the camera that are passed as arrays. They
include the path through the view direction, because the image depends on it. `ubs train` ignores this path. With the
setting query_grad=False, it is ignored here, too."""

from __future__ import annotations

import inspect
from typing import Any, Callable

import jax
import jax.numpy as jnp
import numpy as np

from ._data import Camera, FloatArray, checked_camera
from ._device import DeviceLike
from ._drawing import Drawing, check_view_shape, seen, v_view
from ._model import Model

Parameters = dict[str, Any]
Given = tuple[Any, Any, Any]  # the pose, the intrinsics and the time that replace those of a camera, or None for each
# jax.vmap() calls the functions for one element after the other. JAX before 0.4.34 does so without the option.
_SEQUENTIAL = {"vmap_method": "sequential"} if "vmap_method" in inspect.signature(jax.pure_callback).parameters else {}


def _callback(function: Callable[..., Any], result: Any, *arguments: Any) -> Any:
    return jax.pure_callback(function, result, *arguments, **_SEQUENTIAL)


def _numbers(given: Given) -> list[Any]:
    return [None if x is None else np.asarray(x, np.float64) for x in given]


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

    def view(self, camera: Camera) -> Callable[..., tuple[Any, ...]]:
        """Returns a function f(parameters, pose=None, intrinsics=None, time=None) that renders this camera. The
        function returns rgb (H, W, 3), which is not clamped, alpha (H, W), and, if the object was created with
        depth=True, depth (H, W).

        The arrays `pose`, `intrinsics` and `time` replace the values of the camera, and get gradients. The shape of
        pose is (3, 4) or (4, 4). intrinsics are fx, fy, cx and cy (4,), or a matrix (3, 3). If the matrix of the pose
        is not exactly a rotation, the nearest rotation is used for the image and its gradient."""
        size = (checked_camera(camera).height, camera.width)
        shapes = [(*size, 3), size, size][: 3 if self._depth else 2]
        pictures = tuple(jax.ShapeDtypeStruct(shape, np.float32) for shape in shapes)

        def seen_with(given: Given) -> Camera:
            return seen(camera, *_numbers(given))

        # JAX calls these functions from its own threads, so they must hold the lock.
        def draw(parameters: Parameters, given: Given, for_gradient: bool = False) -> tuple[FloatArray | None, ...]:
            with self._drawing.lock:
                image = self._drawing.draw(seen_with(given), self._arrays(parameters), for_gradient)
            return (image.rgb, image.alpha, image.depth)[: len(pictures)]

        def draw_for_gradient(parameters: Parameters, given: Given) -> tuple[FloatArray | None, ...]:
            return draw(parameters, given, True)

        def differentiate(parameters: Parameters, given: Given, v: tuple[Any, ...]) -> tuple[Any, ...]:
            v_pictures = [np.asarray(x) for x in v]
            with self._drawing.lock:
                found = self._drawing.differentiate(seen_with(given), self._arrays(parameters), v_pictures)
                if all(x is None for x in given):
                    return found, given
                gradient = self._drawing.renderer.camera_gradient()
            v_given = zip(given, v_view(_numbers(given), gradient))
            return found, tuple(None if x is None else np.asarray(v_x, x.dtype) for x, v_x in v_given)

        def rendered(parameters: Parameters, given: Given) -> Any:
            return _callback(draw, pictures, parameters, given)

        def forward(parameters: Parameters, given: Given) -> tuple[Any, Any]:
            return _callback(draw_for_gradient, pictures, parameters, given), (parameters, given)

        def backward(kept: Any, v: tuple[Any, ...]) -> Any:
            like = jax.tree_util.tree_map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype), kept)
            return _callback(differentiate, like, *kept, v)

        function = jax.custom_vjp(rendered)
        function.defvjp(forward, backward)

        def view(parameters: Parameters, pose: Any = None, intrinsics: Any = None, time: Any = None) -> tuple[Any, ...]:
            arrays = {"pose": pose, "intrinsics": intrinsics, "time": time}
            for what, array in arrays.items():
                if array is not None:
                    arrays[what] = jnp.asarray(array, float)
                    check_view_shape(what, arrays[what].shape)
            pictures: tuple[Any, ...] = function(parameters, tuple(arrays.values()))
            return pictures

        return view

    def model(self, parameters: Parameters) -> Model:
        """Returns a copy of the model with these values."""
        with self._drawing.lock:
            self._drawing.put(self._arrays(parameters))
            return self._drawing.model.copy()
