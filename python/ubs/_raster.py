# SPDX-License-Identifier: Apache-2.0
"""Renders projected splats, which are ellipses in an image, as a differentiable function of PyTorch.

The renderer of the library needs splats in 3D space. So this module converts each ellipse to a flat splat, which is
parallel to the image plane of a pinhole camera at the origin. The splat is at the depth of the ellipse, and its size is
chosen so that this camera sees the ellipse. The gradients of the ellipses are the gradients of these splats, multiplied
by known factors."""

from __future__ import annotations

import functools
import math
import threading
import weakref
from dataclasses import dataclass, replace
from typing import Any, Callable, Iterator, TypeVar, cast

import numpy as np
import torch
from torch import Tensor

from ._data import Camera
from ._dlpack import DeviceArray
from ._device import Device, DeviceLike, opened
from ._errors import NumericalError, UsageError
from ._falloff import Falloff
from ._model import PIXEL_GRADIENTS, Model, Renderer

Result = TypeVar("Result")

# Thickness of a flat splat, relative to the larger diagonal entry of the Cholesky factor of its ellipse. The kernels
# raise values below UBS_NEEDLE_CHOLESKY (kernels/limits.h) to this limit. THICKNESS is slightly above the limit.
THICKNESS = 4e-4
BEHIND = -1.0  # a depth that the camera of flat splats does not see
FREE_SLOTS = 3  # number of renderers that are kept for later calls, for all devices together


class Slot:
    """A renderer that is kept for later calls. The caller must hold `lock` while it uses a Slot."""

    def __init__(self, device: Device, form: Any, renderer: Renderer | None, shared: bool) -> None:
        """shared: whether the renderer shares its memory with other packages, which is the case on CUDA devices and on
        CPUs with PoCL."""
        self.device, self.form, self.shared = device, form, shared
        self._renderer = renderer
        self.lock = threading.Lock()
        # The camera of the image that the device can differentiate without rendering it again, or None.
        self.kept: Camera | None = None

    @property
    def renderer(self) -> Renderer:
        assert self._renderer is not None
        return self._renderer

    def fits(self, count: int) -> bool:
        """Returns whether the renderer is suitable for this number of splats."""
        return True

    def outgrown(self, count: int) -> bool:
        """Returns whether the renderer has become too small for its scene, which has this number of splats."""
        return False

    def array(self, name: str, size: tuple[int, int] = (0, 0)) -> Tensor:
        tensor: Tensor = cast(Any, torch).from_dlpack(self.renderer.array(name, size=size))
        return tensor

    def draw(self, camera: Camera, where: torch.device, for_gradient: bool) -> tuple[Tensor, Tensor]:
        """Renders an image, and returns copies of the image (H, W, 3) and of its alpha (H, W)."""
        if not self.shared or where.type == "cpu":
            image = self.renderer.render(camera, for_gradient=for_gradient)
            self.kept = camera if for_gradient else None
            return torch.from_numpy(image.rgb).to(where), torch.from_numpy(image.alpha).to(where)
        self.renderer.draw(camera, for_gradient=for_gradient)
        self.kept = camera if for_gradient else None
        rgb = torch.empty((camera.height, camera.width, 3), dtype=torch.float32, device=where)
        rgb.copy_(self.array("rgb"))
        alpha = (1 - self.array("transmittance")).to(where)
        wait(rgb, alpha)
        return rgb, alpha

    def propagate(
        self, camera: Camera, v_rgb: Tensor | None, v_alpha: Tensor | None, more: tuple[Tensor, ...] | None = None
    ) -> list[dict[str, Any]]:
        """Computes the gradients of the splats from those of the image. Leaves them on the device if the memory is
        shared. Otherwise, returns those of the parameters as Renderer.vjp() does. `more` is that of Renderer.vjp()."""
        if self.kept is not camera:
            self.renderer.draw(camera, for_gradient=True)
        self.kept = None
        copied: list[dict[str, Any]] = []
        further: Any = None if more is None else [part.detach().cpu().numpy() for part in more]
        if self.shared:
            images: Any = gradients_on_device(self.renderer, camera, v_rgb, v_alpha)
            self.renderer.vjp(None, *images, parameters=False, more=further)
        else:
            images = (None if v is None else v.contiguous().cpu().numpy() for v in (v_rgb, v_alpha))
            copied = cast(Any, self.renderer.vjp(None, *images, more=further))
        self.kept = camera if v_alpha is None else None
        return copied


@dataclass(frozen=True)
class FlatForm:
    """Describes the kind of flat splats that a renderer renders."""

    kernel: str  # "gaussian" or "beta"
    absgrad: bool = False  # whether the gradients of xyz are sums of absolute values
    falloff: Falloff | None = None  # replaces the kernel beta

    def settings(self) -> dict[str, Any]:
        return {"dim": 3, "kernel": self.kernel, "eps2d": 0, "background": (0, 0, 0), "cov_param": "cholesky",
                "near_plane": 1e-6, "far_plane": 1e30}

    def widths(self) -> dict[str, int]:
        """Returns the names of the parameters in the order of the library, and for each its number of values per
        splat."""
        beta = {"beta": 1} if self.kernel == "beta" else {}
        return {"xyz": 3, "rgb": 3, "opacity": 1, **beta, "scale": 3, "l_triangle": 3}

    def slot(self, device: Device, count: int) -> FlatSlot:
        return FlatSlot(device, -(-max(count * 5 // 4, 16) // 256) * 256, self)


class FlatSlot(Slot):
    """A renderer of flat splats with a capacity of `room` splats. If fewer splats are used, the others are made
    invisible."""

    def __init__(self, device: Device, room: int, form: FlatForm) -> None:
        self.model = Model.empty(splats=room, **form.settings())
        renderer = Renderer(self.model, device, gradients=True, absgrad=form.absgrad, falloff=form.falloff)
        try:
            renderer.array("parameters")
            shared = True
        except UsageError:
            shared = False
        super().__init__(device, form, renderer, shared)
        values, self.widths = self.model.parameters, form.widths()
        if {name: values[name].shape[1] for name in values} != self.widths:
            raise UsageError(f"the library has the parameters {tuple(values)}, not {tuple(self.widths)} as expected")
        self.host = {name: torch.from_numpy(values[name].T) for name in values}
        self.room = self.used = room
        self.holds: object = None  # identifies the values on the device

    def fits(self, count: int) -> bool:
        return count <= self.room <= 4 * count + 4096

    def outgrown(self, count: int) -> bool:
        return count / 2 <= self.room < count

    def _split(self, rows: Tensor) -> dict[str, Tensor]:
        return dict(zip(self.widths, rows.split(list(self.widths.values()))))

    def put(self, holder: object, values: dict[str, Tensor]) -> None:
        """Copies the values (values per splat, splats) of these parameters to the device. `holder` identifies the
        values: the attribute `holds` has this value until other values are copied."""
        self.holds, self.kept = None, None
        parts = self._split(self.array("parameters")) if self.shared else self.host
        for name, value in values.items():
            parts[name][:, : value.shape[-1]].copy_(value)
        if "xyz" in values:
            count = values["xyz"].shape[1]
            parts["xyz"][2, count : self.used] = BEHIND
            self.used = count
        if self.shared:
            wait(parts["xyz"], *values.values())
        else:
            self.renderer.update(self.model)
        self.holds = holder

    def differentiate(
        self, camera: Camera, v_rgb: Tensor | None, v_alpha: Tensor | None, more: tuple[Tensor, ...] | None = None
    ) -> dict[str, Tensor]:
        """Returns the gradients of each parameter for the used splats. They are valid until the next call. `more` is
        that of Renderer.vjp(), with the values of the used splats."""
        if more is not None:
            rest = torch.zeros((self.room - len(more[2]), more[2].shape[1]))
            more = (*more[:2], torch.cat([more[2].detach().cpu(), rest]))
        copied = self.propagate(camera, v_rgb, v_alpha, more)
        if not self.shared:
            return {name: torch.from_numpy(values.T)[:, : self.used] for name, values in copied[0].items()}
        rows = self.array("gradient")[:, : self.used]
        if not is_finite(rows):
            raise NumericalError("a gradient of the splats is not finite")
        return self._split(rows)


def wait(*tensors: Tensor) -> None:
    """Waits for the streams of torch, because the library does not synchronise with them."""
    for device in {tensor.device for tensor in tensors if tensor.is_cuda}:
        torch.cuda.current_stream(device).synchronize()


def gradients_on_device(renderer: Renderer, camera: Camera, *given: Tensor | None) -> list[DeviceArray | None]:
    """Copies the gradients with respect to the last image (H, W, 3), to its alpha (H, W), and to its depth (H, W), to
    the memory of the device. Returns the arguments for Renderer.vjp(None, ...)."""
    size = camera.height, camera.width
    found = [None if v is None else renderer.array(name, size=size) for name, v in zip(PIXEL_GRADIENTS, given)]
    copied: list[Tensor] = []
    for array, tensor in zip(found, given):
        if tensor is not None:
            into: Tensor = cast(Any, torch).from_dlpack(array)
            into.copy_(tensor)
            copied += [tensor, into]
    wait(*copied)
    return found


_slots: list[Slot] = []  # the most recently used one is at the end
_slots_lock = threading.Lock()


def slot_for(device: DeviceLike, count: int, form: Any) -> Any:
    """Returns a kept renderer of this form that is suitable for `count` splats. If there is none, creates one with
    form.slot()."""
    where = opened(device)
    with _slots_lock:
        alike = [s for s in _slots if (s.device, s.form) == (where, form)]
        fitting = [s for s in alike if s.fits(count)]
        if fitting:
            slot = fitting[-1]
            _slots.remove(slot)
        else:
            _slots[:] = [s for s in _slots if s not in alike or not s.outgrown(count)]
            slot = form.slot(where, count)
        _slots.append(slot)
        del _slots[:-FREE_SLOTS]
    return slot


def scale_inverse(scale: Tensor) -> Tensor:
    return scale + torch.log(-torch.expm1(-scale))


def extremes(tensor: Tensor) -> tuple[float, float]:
    """Returns the minimum and the maximum, NaN if a value is NaN, and 0 for an empty tensor."""
    if tensor.numel() == 0:
        return 0.0, 0.0
    low, high = torch.aminmax(tensor.detach())  # reads the values once, while torch.isfinite reads them several times
    return float(low), float(high)


def is_finite(tensor: Tensor) -> bool:
    # A sum is faster than the minimum and the maximum, but the sum of finite values may overflow.
    return math.isfinite(float(tensor.detach().sum())) or all(map(math.isfinite, extremes(tensor)))


def stacked(tensors: list[Tensor]) -> Tensor:
    """Does the same as torch.stack(), but does not copy a single tensor."""
    return tensors[0][None] if len(tensors) == 1 else torch.stack(tensors)


class Rows:
    """The parameters of the flat splats that represent ellipses, and the factors of their gradients."""

    def __init__(
        self,
        size: tuple[int, int],
        means2d: Tensor,
        factor: Tensor,
        depths: Tensor,
        opacities: Tensor,
        betas: Tensor | None,
    ) -> None:
        width, height = size
        focal = float(max(size))
        zero, one = torch.zeros_like(depths), torch.ones_like(depths)
        drawn = depths > 0
        centre = means2d.T - means2d.new_tensor([[width / 2], [height / 2]])
        centre = torch.where(drawn, centre, zero)
        factor = torch.where(drawn, factor, one)
        opacities = torch.where(drawn, opacities, zero)
        z = torch.where(drawn, depths, one)
        # Multiply the depth by a power of two. This does not change the order, and makes the scales close to one, where
        # softplus is accurate.
        larger = 2.0 ** math.ceil(math.log2(focal))
        self.unit = z * (larger / focal)  # the size of a pixel at the depth of each splat
        self.xyz = torch.cat([centre * self.unit, torch.where(drawn, z * larger, z * BEHIND)[None]])
        l00, l10, l11 = factor
        thin = torch.maximum(l00, l11) * THICKNESS
        self.scale = scale_inverse((torch.stack([l00, l11, thin]) * self.unit).clamp_min(1e-30))
        self.triangle = torch.stack([l10 * self.unit, zero, zero])
        self.opacity = torch.logit(opacities.clamp(1e-8, 1 - 2.0**-24))[None]
        self.betas = betas

    def as_values(self) -> dict[str, Tensor]:
        values = {"xyz": self.xyz, "opacity": self.opacity, "scale": self.scale, "l_triangle": self.triangle}
        return values if self.betas is None else {**values, "beta": torch.log(self.betas / 4)[None]}

    def gradients(self, v: dict[str, Tensor]) -> list[Tensor]:
        """Returns the gradients with respect to means2d, factor and opacities, and betas if there are any."""
        v_scale = v["scale"][:2] / torch.sigmoid(self.scale[:2]) * self.unit
        v_factor = torch.stack([v_scale[0], v["l_triangle"][0] * self.unit, v_scale[1]])
        slope = torch.sigmoid(self.opacity) * torch.sigmoid(-self.opacity)
        found = [(v["xyz"][:2] * self.unit).T, v_factor, (v["opacity"] / slope)[0]]
        return found if self.betas is None else [*found, v["beta"][0] / self.betas]


def first_order(function: Callable[..., Result]) -> Callable[..., Result]:
    """Makes a backward() raise UsageError if PyTorch would record it for second-order gradients. torch's
    once_differentiable is not sufficient: it raises no error, and gives wrong results, if the gradient of the output is
    a constant, or if torch.autograd.grad() reaches its input in another way."""

    @functools.wraps(function)
    def checked(*arguments: Any) -> Result:
        if torch.is_grad_enabled():
            raise UsageError("ubs has no second-order gradients of images: compute gradients without create_graph")
        return function(*arguments)

    return checked


class SparseGradient(torch.autograd.Function):
    """Returns its first input unchanged, but makes the gradient of this tensor sparse. The second input is a list with
    one tensor, which contains the indices of the rows of the gradient. The caller may fill the list until backward()
    runs."""

    @staticmethod
    def forward(ctx: Any, *inputs: Any, **_: Any) -> Tensor:
        tensor: Tensor = inputs[0]
        ctx.rows = inputs[1]
        return tensor.view_as(tensor)

    @staticmethod
    def backward(ctx: Any, *gradients: Any) -> tuple[Any, None]:
        gradient, (rows,) = gradients[0], ctx.rows
        return torch.sparse_coo_tensor(rows[None], gradient[rows], gradient.shape), None


class AbsGrad:
    """Holds the sums over pixels of the absolute gradients of means2d, which backward() stores as `absgrad`."""

    def __init__(self, means2d: Tensor, first: int, chunk: int, background: Tensor | None) -> None:
        """The sums of an image start at row `first` of means2d (..., 2). Each `chunk` of channels has separate sums,
        which are added. background (D,): the colour that the caller blends behind the image."""
        # The tensor refers to the autograd node that contains this object, so a strong reference would keep both alive
        # forever.
        self.means2d, self.first, self.chunk = weakref.ref(means2d), first, chunk
        self.background = None if background is None else background.detach()

    def chunks(
        self, v_image: Tensor | None, v_alpha: Tensor | None
    ) -> Iterator[tuple[int, Tensor | None, Tensor | None]]:
        """Divides the gradients of an image (H, W, D) and of its alpha (H, W) into gradients of chunks of channels.
        Each chunk gets the part of v_alpha that comes from blending its channels with the background. The first chunk
        also gets the remaining part of v_alpha. Yields the index of the first channel of a chunk, and its two
        gradients. Uses no matrix products, which would lose precision in torch.autocast."""
        if v_image is None or v_image.shape[-1] <= self.chunk:
            yield 0, v_image, v_alpha
            return
        if self.background is not None and v_alpha is not None:
            v_alpha = v_alpha + (v_image * self.background).sum(-1)
        for first in range(0, v_image.shape[-1], self.chunk):
            part, v_part = v_image[..., first : first + self.chunk], v_alpha if first == 0 else None
            if self.background is not None:
                blended = (part * self.background[first : first + self.chunk]).sum(-1)
                v_part = -blended if v_part is None else v_part - blended
            yield first, part, v_part

    def put(self, sums: Tensor) -> None:
        means2d: Any = self.means2d()
        if means2d is not None:
            means2d.absgrad.view(-1, 2)[self.first : self.first + len(sums)] = sums


class Draw(torch.autograd.Function):
    """Rasterises splats, three channels at a time.

    The inputs are: whether gradients are recorded, (width, height), a device of ubs, an AbsGrad or None, a Falloff or
    None, means2d (n, 2), factor (3, n), depths (n,), colors (n, D), opacities (n,), and betas (n,) or None. The outputs
    are the image (H, W, D) and its alpha (H, W)."""

    @staticmethod
    def forward(ctx: Any, *inputs: Any, **_: Any) -> tuple[Tensor, ...]:
        recorded: bool = inputs[0]
        size: tuple[int, int] = inputs[1]
        device: DeviceLike = inputs[2]
        falloff: Falloff | None = inputs[4]
        means2d, factor, depths, colors, opacities, betas = inputs[5:]
        where, (width, height) = means2d.device, size
        ctx.save_for_backward(means2d, factor, depths, colors, opacities, betas)
        ctx.set_materialize_grads(False)
        ctx.size, ctx.slot, ctx.absgrad = size, None, inputs[3]
        count, channels = colors.shape
        if count == 0:
            return colors.new_zeros((height, width, channels)), colors.new_zeros((height, width))
        rows = Rows(size, means2d, factor, depths, opacities, betas)
        for name, tensor in (("centre", rows.xyz), ("ellipse", rows.scale), ("ellipse", rows.triangle), ("colour", colors)):
            if not is_finite(tensor):
                raise NumericalError(f"the projected {name} of a splat is not finite: its parameters are too large")
        ctx.camera = _camera(size)
        ctx.slot = slot_for(device, count, FlatForm("gaussian" if betas is None else "beta", falloff=falloff))
        ctx.holder = object()
        images = []
        with ctx.slot.lock:
            for first in range(0, max(channels, 1), 3):
                values = {"rgb": _three(colors, first, depths)}
                ctx.slot.put((ctx.holder, first), {**rows.as_values(), **values} if first == 0 else values)
                rgb, alpha = ctx.slot.draw(ctx.camera, where, recorded and any(ctx.needs_input_grad))
                images.append(rgb)
        # PyTorch does not allow callers to change the image in place if it is a view.
        image = images[0] if len(images) == 1 else torch.cat(images, -1)
        if ctx.absgrad is not None and recorded and ctx.absgrad.chunk > 3:
            ctx.more = image[..., 3:channels].clone()  # the caller may change the image
        return image if image.shape[-1] == channels else image[..., :channels].clone(), alpha

    @staticmethod
    @first_order
    def backward(ctx: Any, v_image: Tensor | None, v_alpha: Tensor | None) -> tuple[Any, ...]:
        means2d, factor, depths, colors, opacities, betas = ctx.saved_tensors
        v_colors = torch.zeros_like(colors)
        total: list[Tensor] = [torch.zeros_like(t) for t in (means2d, factor, opacities, betas) if t is not None]
        sums = torch.zeros_like(means2d)
        if ctx.slot is not None and (v_image is not None or v_alpha is not None):
            where, slot, channels = means2d.device, ctx.slot, colors.shape[1]
            rows = Rows(ctx.size, means2d, factor, depths, opacities, betas)
            passes = range(0, max(channels, 1), 3) if v_image is not None else range(1)
            with slot.lock:
                for first in reversed(passes):  # starts with the last rendered channels, which are still on the device
                    if slot.holds is None or slot.holds != (ctx.holder, first):
                        mine = slot.holds is not None and slot.holds[0] is ctx.holder
                        values = {"rgb": _three(colors, first, depths)}
                        slot.put((ctx.holder, first), values if mine else {**rows.as_values(), **values})
                    v_rgb = None if v_image is None else padded(v_image[..., first : first + 3])
                    v = slot.differentiate(ctx.camera, v_rgb, v_alpha if first == 0 else None)
                    v = {name: tensor.to(where) for name, tensor in v.items()}
                    width = min(3, channels - first)
                    v_colors[:, first : first + width] = v["rgb"][:width].T
                    total = [a + b for a, b in zip(total, rows.gradients(v))]
                    wait(*total)
            if ctx.absgrad is not None:
                slot = slot_for(slot.device, len(means2d), replace(slot.form, absgrad=True))
                with slot.lock:
                    for first, v_part, v_weight in ctx.absgrad.chunks(v_image, v_alpha):
                        last = min(first + ctx.absgrad.chunk, channels)
                        values = {"rgb": _three(colors[:, :last], first, depths)}
                        slot.put((ctx.holder, first), {**rows.as_values(), **values} if first == 0 else values)
                        more = None
                        if v_part is not None and last - first > 3:
                            more = v_part[..., 3:], ctx.more[..., first : last - 3], colors[:, first + 3 : last]
                        v_rgb = None if v_part is None else padded(v_part[..., :3])
                        v = slot.differentiate(ctx.camera, v_rgb, v_weight, more)
                        sums = sums + rows.gradients({name: tensor.to(where) for name, tensor in v.items()})[0]
        if ctx.absgrad is not None:
            ctx.absgrad.put(sums)
        v_betas = None if betas is None else total[3]
        return (None, None, None, None, None, total[0], total[1], None, v_colors, total[2], v_betas)


def _camera(size: tuple[int, int]) -> Camera:
    width, height = size
    focal = float(max(size))
    return Camera.from_matrix(np.eye(4), (focal, focal, width / 2, height / 2), width, height)


def padded(tensor: Tensor) -> Tensor:
    """Returns the last dimension padded with zeros to three values."""
    missing = 3 - tensor.shape[-1]
    return tensor if missing == 0 else cast(Tensor, torch.nn.functional.pad(tensor, (0, missing)))


def _three(colors: Tensor, first: int, depths: Tensor) -> Tensor:
    """Returns three channels starting with `first`, as rows. The values of ellipses with a depth of 0 or less, and of
    channels that do not exist, are 0."""
    part = padded(colors[:, first : first + 3]).T
    return torch.where(depths > 0, part, torch.zeros_like(part))


def draw(
    size: tuple[int, int],
    device: DeviceLike,
    absgrad: AbsGrad | None,
    means2d: Tensor,
    factor: Tensor,
    depths: Tensor,
    colors: Tensor,
    opacities: Tensor,
    betas: Tensor | None = None,
    falloff: Falloff | None = None,
) -> tuple[Tensor, Tensor]:
    """Renders ellipses. Returns an image (H, W, D) without a background, and its alpha (H, W).

    means2d (n, 2) [px]; factor (3, n): l00, l10, l11 of the lower Cholesky factor of each covariance [px]; depths (n,),
    which determine the order (ellipses with a depth of 0 or less are not rendered); colors (n, D); opacities (n,), 0 to
    1. betas (n,): exponents of Beta kernels; with None, the ellipses are Gaussians. falloff: a function that replaces
    the Beta kernel."""
    image, alpha = Draw.apply(
        torch.is_grad_enabled(), size, device, absgrad, falloff, means2d, factor, depths, colors, opacities, betas
    )
    return image, alpha
