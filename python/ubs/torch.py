# SPDX-License-Identifier: Apache-2.0
"""Drawing as a differentiable function of PyTorch, for models that are learnt with its optimisers and losses.

    import ubs, ubs.torch
    splats = ubs.torch.Splats(ubs.Model.initial(data, dim=6))
    rgb, alpha = splats(camera)                      # (H, W, 3), (H, W)
    my_loss(rgb, alpha).backward()

Tensors are those of the CPU; a device of ubs draws, whichever that is. Gradients reach every raw parameter, from colours
and alpha. There are none of the camera, and none of second order. Models have splats of one dimension."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from ._data import Camera
from ._device import DeviceLike
from ._model import Model, Renderer


class _Drawing:
    """A model to write tensors into, and its renderer."""

    def __init__(self, model: Model, device: DeviceLike) -> None:
        self.model = model.copy()
        self.values = self.model.parameters
        self.names = list(self.values)
        self.renderer = Renderer(self.model, device, gradients=True)

    def put(self, tensors: tuple[Tensor, ...]) -> None:
        for name, tensor in zip(self.names, tensors):
            if tensor.device.type != "cpu" or tensor.dtype != torch.float32:
                raise ValueError(f"{name} is {tensor.dtype} on {tensor.device}: ubs.torch takes float32 on the CPU")
            if tuple(tensor.shape) != self.values[name].shape:
                raise ValueError(f"{name} has the shape {tuple(tensor.shape)}, not {self.values[name].shape}")
            self.values[name][...] = tensor.detach().numpy()
        self.renderer.update(self.model)


class _Render(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, drawing: _Drawing, camera: Camera, *tensors: Tensor) -> tuple[Tensor, Tensor]:
        drawing.put(tensors)
        image = drawing.renderer.render(camera)
        ctx.drawing, ctx.camera = drawing, camera
        ctx.save_for_backward(*tensors)
        return torch.from_numpy(image.rgb), torch.from_numpy(image.alpha)

    @staticmethod
    @torch.autograd.function.once_differentiable  # type: ignore[misc]
    def backward(ctx: Any, v_rgb: Tensor, v_alpha: Tensor) -> tuple[Any, ...]:
        drawing: _Drawing = ctx.drawing
        drawing.put(ctx.saved_tensors)  # another picture may have been drawn since
        v = drawing.renderer.vjp(ctx.camera, v_rgb.detach().numpy(), v_alpha.detach().numpy())[0]
        # Contiguous: a transposed gradient costs every later operation.
        return (None, None, *(torch.from_numpy(v[name]).contiguous() for name in drawing.names))


class Splats(torch.nn.Module):
    """The raw parameters of a model as a module: one torch.nn.Parameter (splats, values of one) a name of
    Model.parameters, such as `xyz`."""

    def __init__(self, model: Model, device: DeviceLike = None) -> None:
        super().__init__()
        self._drawing = _Drawing(model, device)
        for name, values in self._drawing.values.items():
            self.register_parameter(name, torch.nn.Parameter(torch.from_numpy(values.copy()).contiguous()))

    def _tensors(self) -> tuple[Tensor, ...]:
        return tuple(getattr(self, name) for name in self._drawing.names)

    def forward(self, camera: Camera) -> tuple[Tensor, Tensor]:
        """rgb (H, W, 3), not clamped, and alpha (H, W)."""
        rgb, alpha = _Render.apply(self._drawing, camera, *self._tensors())
        return rgb, alpha

    def model(self) -> Model:
        """A copy with the values that the parameters have now."""
        self._drawing.put(self._tensors())
        return self._drawing.model.copy()
