# SPDX-License-Identifier: Apache-2.0
"""Rendering as a differentiable function of PyTorch, to train models with its optimisers and loss functions.

    import ubs, ubs.torch
    splats = ubs.torch.Splats(ubs.Model.initial(data, dim=6))
    rgb, alpha = splats(camera)                      # (H, W, 3), (H, W)
    my_loss(rgb, alpha).backward()

Any device of ubs can render. Tensors on a card on which ubs renders with CUDA stay there (DLPack); other tensors are
copied through host memory. Colours, alpha and depth have gradients with respect to every raw parameter, and with
respect to the camera if it is passed as tensors. Second-order gradients are not supported. All splats of a model must
have the same dimension."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Callable, Sequence, TypeVar, cast

import torch
from torch import Tensor

from ._data import Camera, FloatArray
from ._device import DeviceLike
from ._drawing import Drawing
from ._errors import NumericalError, UsageError
from ._model import Model

Result = TypeVar("Result")


def _checked(tensor: Tensor) -> Tensor:
    if tensor.dtype != torch.float32:
        raise UsageError(f"a parameter is of {tensor.dtype}: ubs.torch takes float32")
    return tensor.detach()


def _array(tensor: Tensor) -> FloatArray:
    array: FloatArray = _checked(tensor).cpu().numpy()
    return array


def _is_shared(drawing: Drawing, tensor: Tensor) -> bool:
    """Returns whether the tensor is in the memory of the device that renders."""
    return drawing.place == ((2, tensor.device.index) if tensor.is_cuda else (1, 0))


def _shared(drawing: Drawing, name: str, size: tuple[int, int] = (0, 0)) -> Tensor:
    tensor: Tensor = cast(Any, torch).from_dlpack(drawing.renderer.array(name, size=size))
    return tensor


def _copy(drawing: Drawing, name: str) -> Tensor:
    return _shared(drawing, name).clone(memory_format=torch.contiguous_format)


def _wait(tensor: Tensor) -> None:
    if tensor.is_cuda:
        torch.cuda.current_stream(tensor.device).synchronize()


def _put(drawing: Drawing, parameters: Sequence[Tensor]) -> None:
    for name, tensor in zip(drawing.names, parameters):
        drawing.check_shape(name, tensor.shape)  # copy_() would copy a single splat to all
    if not _is_shared(drawing, parameters[0]):
        drawing.put([_array(tensor) for tensor in parameters])
        return
    rows = _shared(drawing, "parameters")
    for part, tensor in zip(rows.split([tensor.shape[1] for tensor in parameters]), parameters):
        part.copy_(_checked(tensor).T)
    _wait(rows)


def _draw(drawing: Drawing, camera: Camera, parameters: Sequence[Tensor]) -> tuple[Tensor, ...]:
    _put(drawing, parameters)
    if not _is_shared(drawing, parameters[0]):
        image = drawing.renderer.render(camera)
        pictures = (image.rgb, image.alpha) if image.depth is None else (image.rgb, image.alpha, image.depth)
        return tuple(torch.from_numpy(picture).to(parameters[0].device) for picture in pictures)
    drawing.renderer.draw(camera)
    pair = (_copy(drawing, "rgb"), 1 - _shared(drawing, "transmittance"))
    return (*pair, _copy(drawing, "depth")) if drawing.depth else pair


def _differentiate(
    drawing: Drawing, camera: Camera, parameters: Sequence[Tensor], v: Sequence[Tensor | None]
) -> list[Tensor]:
    """Returns contiguous gradients of each parameter, because a transposed gradient slows down every later
    operation."""
    _put(drawing, parameters)  # another image may have been rendered since
    if not _is_shared(drawing, parameters[0]):
        found = drawing.renderer.vjp(camera, *(None if t is None else _array(t) for t in v))[0]
        where = parameters[0].device
        return [torch.from_numpy(found[name]).contiguous().to(where) for name in drawing.names]
    if v[0] is not None and all(t is None for t in v[1:]):
        array = drawing.renderer.array("v_rgb", size=(camera.height, camera.width))
        torch.from_dlpack(array).copy_(v[0])
        _wait(v[0])
        drawing.renderer.vjp(camera, array, parameters=False)
    else:
        drawing.renderer.vjp(camera, *(None if t is None else _array(t) for t in v), parameters=False)
    rows = _shared(drawing, "gradient")
    if not bool(torch.isfinite(rows).all()):
        raise NumericalError("a gradient of the parameters is not finite")
    parts = rows.split([tensor.shape[1] for tensor in parameters])
    return [part.T.clone(memory_format=torch.contiguous_format) for part in parts]


def _seen(camera: Camera, pose: Tensor | None, intrinsics: Tensor | None, time: Tensor | None) -> Camera:
    if pose is not None:
        camera = replace(camera, world_to_camera=pose.detach().double().cpu().numpy())
    if intrinsics is not None:
        fx, fy, cx, cy = (float(v) for v in intrinsics.detach())
        camera = replace(camera, fx=fx, fy=fy, cx=cx, cy=cy)
    return camera if time is None else camera.at(float(time.detach()))


def _first_order(function: Callable[..., Result]) -> Callable[..., Result]:
    """torch's once_differentiable, which has no type annotations."""
    made: Callable[..., Result] = cast(Any, torch.autograd.function).once_differentiable(function)
    return made


class _Render(torch.autograd.Function):
    """Inputs: the drawing; a camera; pose, intrinsics and time that replace those of the camera, or None; the
    parameters."""

    @staticmethod
    def forward(ctx: Any, *inputs: Any, **_: Any) -> tuple[Tensor, ...]:
        drawing, camera, *ctx.view = inputs[:5]
        parameters: tuple[Tensor, ...] = inputs[5:]
        ctx.drawing, ctx.camera = drawing, _seen(camera, *ctx.view)
        ctx.save_for_backward(*parameters)
        ctx.set_materialize_grads(False)
        with drawing.lock:
            return _draw(drawing, ctx.camera, parameters)

    @staticmethod
    @_first_order
    def backward(ctx: Any, *v_pictures: Tensor | None) -> tuple[Any, ...]:
        drawing: Drawing = ctx.drawing
        view: list[Tensor | None] = [None, None, None]
        seen = any(t is not None and t.requires_grad for t in ctx.view)
        with drawing.lock:
            found = _differentiate(drawing, ctx.camera, ctx.saved_tensors, v_pictures)
            camera = drawing.renderer.camera_gradient() if seen else None
        if camera is not None:
            for k, values in enumerate((camera.world_to_camera, camera.intrinsics, camera.time)):
                given = ctx.view[k]
                if given is not None:
                    view[k] = torch.as_tensor(values, dtype=given.dtype, device=given.device).reshape(given.shape)
        return (None, None, *view, *found)


class Splats(torch.nn.Module):
    """The raw parameters of a model as a module. It has one torch.nn.Parameter (splats, values per splat) for each name
    in Model.parameters, such as `xyz`. With `depth`, images include depth."""

    def __init__(self, model: Model, device: DeviceLike = None, *, depth: bool = False) -> None:
        super().__init__()
        self._drawing = Drawing(model, device, depth)
        for name, values in self._drawing.values.items():
            self.register_parameter(name, torch.nn.Parameter(torch.from_numpy(values.copy()).contiguous()))

    def _tensors(self) -> tuple[Tensor, ...]:
        return tuple(getattr(self, name) for name in self._drawing.names)

    def forward(
        self,
        camera: Camera,
        *,
        pose: Tensor | None = None,
        intrinsics: Tensor | None = None,
        time: Tensor | None = None,
    ) -> tuple[Tensor, ...]:
        """Returns rgb (H, W, 3), not clamped, alpha (H, W), and depth (H, W) if the module was created with it.

        pose (3, 4), intrinsics (4,), which are fx, fy, cx, cy, and time replace those of the camera, and get gradients.
        The gradient of the pose is correct for changes that keep its rotation a rotation, so compute the pose from
        three or four numbers, for example with matrix_exp."""
        pictures: tuple[Tensor, ...] = _Render.apply(
            self._drawing, camera, pose, intrinsics, time, *self._tensors()
        )
        return pictures

    def model(self) -> Model:
        """Returns a copy of the model with the current values of the parameters."""
        with self._drawing.lock:
            self._drawing.put([_array(tensor) for tensor in self._tensors()])
            return self._drawing.model.copy()
