# SPDX-License-Identifier: Apache-2.0
"""Drawing as a differentiable function of PyTorch, for models that are learnt with its optimisers and losses.

    import ubs, ubs.torch
    splats = ubs.torch.Splats(ubs.Model.initial(data, dim=6))
    rgb, alpha = splats(camera)                      # (H, W, 3), (H, W)
    my_loss(rgb, alpha).backward()

A device of ubs draws, whichever that is; tensors that are not the CPU's are copied through host memory, there and
back. Gradients reach every raw parameter, and the camera where it is given as tensors, from colours, alpha and depth.
There are none of second order. Models have splats of one dimension."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Callable, Iterable, TypeVar, cast

import torch
from torch import Tensor

from ._data import Camera, FloatArray
from ._device import DeviceLike
from ._drawing import Drawing
from ._errors import UsageError
from ._model import Model

Result = TypeVar("Result")


def _arrays(tensors: Iterable[Tensor]) -> list[FloatArray]:
    found: list[FloatArray] = []
    for tensor in tensors:
        if tensor.dtype != torch.float32:
            raise UsageError(f"a parameter is of {tensor.dtype}: ubs.torch takes float32")
        found.append(tensor.detach().cpu().numpy())
    return found


def _seen(camera: Camera, pose: Tensor | None, intrinsics: Tensor | None, time: Tensor | None) -> Camera:
    if pose is not None:
        camera = replace(camera, world_to_camera=pose.detach().double().cpu().numpy())
    if intrinsics is not None:
        fx, fy, cx, cy = (float(v) for v in intrinsics.detach())
        camera = replace(camera, fx=fx, fy=fy, cx=cx, cy=cy)
    return camera if time is None else camera.at(float(time.detach()))


def _first_order(function: Callable[..., Result]) -> Callable[..., Result]:
    """torch's once_differentiable, which has no types."""
    made: Callable[..., Result] = cast(Any, torch.autograd.function).once_differentiable(function)
    return made


class _Render(torch.autograd.Function):
    """Inputs: the drawing, a camera, pose, intrinsics and time that replace its own or None, the parameters."""

    @staticmethod
    def forward(ctx: Any, *inputs: Any, **_: Any) -> tuple[Tensor, ...]:
        drawing, camera, *ctx.view = inputs[:5]
        parameters: tuple[Tensor, ...] = inputs[5:]
        ctx.drawing, ctx.camera = drawing, _seen(camera, *ctx.view)
        image = drawing.draw(ctx.camera, _arrays(parameters))
        ctx.save_for_backward(*parameters)
        pictures = (image.rgb, image.alpha) if image.depth is None else (image.rgb, image.alpha, image.depth)
        return tuple(torch.from_numpy(picture).to(parameters[0].device) for picture in pictures)

    @staticmethod
    @_first_order
    def backward(ctx: Any, *v_pictures: Tensor) -> tuple[Any, ...]:
        drawing: Drawing = ctx.drawing
        where = ctx.saved_tensors[0].device
        v = drawing.differentiate(ctx.camera, _arrays(ctx.saved_tensors), _arrays(v_pictures))
        view: list[Tensor | None] = [None, None, None]
        if any(t is not None and t.requires_grad for t in ctx.view):
            camera = drawing.renderer.camera_gradient()
            for k, values in enumerate((camera.world_to_camera, camera.intrinsics, camera.time)):
                given = ctx.view[k]
                if given is not None:
                    view[k] = torch.as_tensor(values, dtype=given.dtype, device=given.device).reshape(given.shape)
        # Contiguous: a transposed gradient costs every later operation.
        return (None, None, *view, *(torch.from_numpy(v[name]).contiguous().to(where) for name in drawing.names))


class Splats(torch.nn.Module):
    """The raw parameters of a model as a module: one torch.nn.Parameter (splats, values of one) a name of
    Model.parameters, such as `xyz`. With `depth` a picture has that too."""

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
        """rgb (H, W, 3), not clamped, alpha (H, W), and depth (H, W) where the module was made with it. pose (3, 4),
        intrinsics (4,), fx, fy, cx, cy, and time take the place of the camera's, and get gradients. That of the pose is
        right for changes that leave its rotation one: make it of three or four numbers, by matrix_exp for instance."""
        pictures: tuple[Tensor, ...] = _Render.apply(
            self._drawing, camera, pose, intrinsics, time, *self._tensors()
        )
        return pictures

    def model(self) -> Model:
        """A copy with the values that the parameters have now."""
        self._drawing.put(_arrays(self._tensors()))
        return self._drawing.model.copy()
