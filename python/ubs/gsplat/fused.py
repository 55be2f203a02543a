# SPDX-License-Identifier: Apache-2.0
"""The fast implementation of rasterization(), in which the device reads the tensors of the Gaussians, projects the
Gaussians and evaluates their spherical harmonics, and writes the gradients to tensors.

It supports the calls that most trainers make: the Gaussians have quaternions and scales, and either spherical harmonics
up to degree 3, which all cameras share, or any number of colour channels. The viewmats and Ks of the pinhole cameras
need no gradients. supports() and rasterization() test all conditions."""

from __future__ import annotations

import ctypes
import functools
import weakref
from dataclasses import dataclass, replace
from typing import Any, Callable

import numpy as np
import torch
from torch import Tensor

from .. import _abi
from .._data import Camera
from .._device import Device, DeviceLike
from .._errors import NumericalError, UsageError
from .._model import Model, Renderer
from .._raster import AbsGrad, Slot, extremes, first_order, is_finite, padded, slot_for, stacked, wait
from .._settings import BOOLEANS
from .meta import Meta

LEAST_ALPHA = 1 / 255  # Gaussians with a lower opacity are not rendered
NOT_A_ROTATION = 2e-6  # a matrix R counts as a rotation if all entries of R R^T - I are below this value


@dataclass
class Gaussians:
    means: Tensor  # (n, 3)
    quats: Tensor  # (n, 4)
    scales: Tensor  # (n, 3), above 0
    opacities: Tensor  # (n,)
    colors: Tensor  # (n, K, 3): coefficients of spherical harmonics, or with K = 1 plain colours

    def tensors(self) -> tuple[Tensor, ...]:
        return self.means, self.quats, self.scales, self.opacities, self.colors

    def to_c(self) -> _abi.Gaussians:
        """Returns the addresses of the tensors, which must be contiguous."""
        means, quats, scales, opacities, colors = (tensor.data_ptr() for tensor in self.tensors())
        return _abi.Gaussians(
            count=len(self.means), means=means, quats=quats, scales=scales, opacities=opacities, colours=colors,
            bases=self.colors.shape[1],
        )


class _GaussianRenderer(Renderer):
    """A renderer that reads Gaussians from tensors in the memory of its device."""

    def __init__(self, model: Model, device: Device, absgrad: bool) -> None:
        self.device = device
        self._create(model, depth=False, gradients=True, absgrad=absgrad, falloff=None, settings={}, gaussians=True)


@dataclass(frozen=True)
class GaussianForm:
    """Describes what a renderer of Gaussians renders."""

    degree: int | None  # of the spherical harmonics; None for plain colours
    eps2d: float
    planes: tuple[float, float]  # the near and the far plane
    antialiased: bool = False
    absgrad: bool = False  # whether the gradients of positions in the image are sums of absolute values

    def slot(self, device: Device, count: int) -> GaussianSlot:
        return GaussianSlot(device, self)


class GaussianSlot(Slot):
    """A renderer of any number of Gaussians."""

    def __init__(self, device: Device, form: GaussianForm) -> None:
        near, far = form.planes
        colour = "rgb" if form.degree is None else f"sh{form.degree}"
        model = Model.empty(
            dim=3, splats=1, kernel="gaussian", rot_mode="quaternion", colour=colour, eps2d=form.eps2d,
            background=(0, 0, 0), near_plane=near, far_plane=far, antialias="on" if form.antialiased else "off",
        )
        try:
            super().__init__(device, form, _GaussianRenderer(model, device, form.absgrad), shared=True)
            self.memory = self.array("v_rgb", (1, 1)).device  # where the tensors must be
        except UsageError:
            super().__init__(device, form, None, shared=False)
        # The Gaussians that the device reads. This is a weak reference, because trainers replace their tensors.
        self.reads: weakref.ref[Gaussians] | None = None

    def readable(self, splats: Gaussians) -> Gaussians:
        """Returns these Gaussians as tensors that the device can read. Copies only tensors that are in other memory or
        not contiguous."""
        return Gaussians(*(t.detach().to(self.memory).contiguous() for t in splats.tensors()))

    def put(self, splats: Gaussians) -> None:
        """Makes the device render the result of readable(). The caller must keep it until it has been rendered, and
        until it has been differentiated."""
        if self.reads is not None and self.reads() is splats:
            return
        self.reads, self.kept = None, None
        wait(*splats.tensors())
        _abi.call("renderer_set_gaussians", self.renderer, ctypes.byref(splats.to_c()))
        self.reads = weakref.ref(splats)

    def positions_gradient(
        self, splats: Gaussians, camera: Camera, v_rgb: Tensor | None, v_alpha: Tensor | None
    ) -> Tensor:
        """Returns the gradient with respect to the positions in the image (n, 2) [1/px], or the sums of absolute values
        that GaussianForm.absgrad describes."""
        self.put(splats)
        self.propagate(camera, v_rgb, v_alpha)
        found = self.array("v_means2d").clone()
        _check_finite(found)
        return found

    def differentiate(
        self, splats: Gaussians, camera: Camera, v_rgb: Tensor | None, v_alpha: Tensor | None
    ) -> tuple[Tensor, tuple[Tensor, ...]]:
        """Returns the result of positions_gradient(), and the gradients of the tensors of the Gaussians, which include
        the effect of the positions."""
        v_means2d = self.positions_gradient(splats, camera, v_rgb, v_alpha)
        v = Gaussians(*(torch.empty_like(tensor) for tensor in splats.tensors()))
        if self.form.degree is not None:
            v.colors[:, (self.form.degree + 1) ** 2 :] = 0
        wait(v_means2d, v.colors)
        _abi.call("renderer_get_gaussian_gradients", self.renderer, ctypes.byref(v.to_c()))
        _check_finite(*v.tensors())
        return v_means2d, v.tensors()


def _check_finite(*gradients: Tensor) -> None:
    if not all(map(is_finite, gradients)):
        raise NumericalError("a gradient of the splats is not finite")


@dataclass
class Drawn:
    """The rendered image of one camera."""

    rgb: Tensor  # (H, W, 3)
    alpha: Tensor  # (H, W)
    # Only for the first pass of a camera: the positions (n, 2) [px], computed with a depth of 1 for Gaussians that are
    # not between the planes, the depths (n,), half the sizes (n, 2) of the rectangles around the ellipses [px], and the
    # opacities (n,) with which the Gaussians are rendered.
    projected: list[Tensor]
    slot: GaussianSlot
    camera: Camera
    splats: Gaussians  # a result of GaussianSlot.readable()


def supports(
    colors: Any, scales: Tensor | None, viewmats: Tensor, ks: Tensor, degree: int | None, planes: tuple[float, float],
    eps2d: float,
) -> bool:
    """Returns whether render() supports these arguments of rasterization(), if they have no batch dimensions. `colors`
    is None if no colours are rendered. The caller has checked all other arguments."""
    if isinstance(degree, BOOLEANS) or degree not in (None, 0, 1, 2, 3) or scales is None or len(viewmats) == 0:
        return False
    count = len(scales)
    if count == 0 or not extremes(scales)[0] > 0:
        return False
    if colors is not None:
        shape = tuple(colors.shape) if isinstance(colors, Tensor) else ()
        if degree is None:
            fits = shape[:-1] in ((count,), (len(viewmats), count)) and shape[-1] > 0
        else:
            fits = len(shape) == 3 and shape[0] == count and shape[1] >= (degree + 1) ** 2 and shape[2] == 3
        if not fits:
            return False
    if torch.is_grad_enabled() and (viewmats.requires_grad or ks.requires_grad):
        return False
    if not (1e-6 <= planes[0] < planes[1] <= 1e30 and eps2d <= 100):
        return False
    matrices = viewmats.detach().cpu().double().numpy()
    turns = matrices[:, :3, :3]
    apart = np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3))
    rigid = (apart < NOT_A_ROTATION).all() and (np.linalg.det(turns) > 0).all()
    return bool(rigid and (matrices[:, 3] == (0, 0, 0, 1)).all())


def draw(
    splats: Gaussians, form: GaussianForm, cameras: list[Camera], first: bool, device: DeviceLike
) -> list[Drawn] | None:
    """Renders the image of each camera. `first` says whether this is the first pass of these cameras. Returns None if
    the device does not share its memory."""
    slot: GaussianSlot = slot_for(device, len(splats.means), form)
    where = splats.means.device
    if not slot.shared:
        return None
    recorded = torch.is_grad_enabled() and any(t.requires_grad for t in splats.tensors())
    found = []
    with torch.no_grad(), slot.lock:
        readable = slot.readable(splats)
        slot.put(readable)
        for camera in cameras:
            rgb, alpha = slot.draw(camera, where, recorded)
            names = ("means2d", "depths", "extents", *(("opacities",) if form.antialiased else ()))
            projected = [slot.array(name).to(where, copy=True) for name in names] if first else []
            if first and not form.antialiased:
                projected.append(splats.opacities)
            found.append(Drawn(rgb, alpha, projected, slot, camera, readable))
    return found


def in_camera(axes: slice, means: Tensor, viewmats: Tensor) -> Tensor:
    """Returns the coordinates (C, n, axes) of the means along these axes of the cameras. Depth is the axis 2."""
    x, y, z = means[:, 0:1], means[:, 1:2], means[:, 2:3]
    columns = viewmats[:, None, axes].unbind(-1)  # not a matrix product, which would lose precision in torch.autocast
    return x * columns[0] + y * columns[1] + z * columns[2] + columns[3]


def positions(means: Tensor, viewmats: Tensor, ks: Tensor, planes: tuple[float, float]) -> tuple[Tensor, Tensor]:
    """Returns the positions (C, n, 2) in the images, and the depths (C, n), as the device computes them."""
    points = in_camera(slice(3), means, viewmats)
    depths = points[..., 2]
    seen = (depths >= planes[0]) & (depths <= planes[1])
    # The depth 1 avoids infinite gradients of Gaussians that are not visible.
    over = 1 / torch.where(seen, depths, torch.ones_like(depths))
    focal = ks[:, None, [0, 1], [0, 1]]
    return focal * points[..., :2] * over[..., None] + ks[:, None, [0, 1], [2, 2]], depths


class Project(torch.autograd.Function):
    """Connects the positions and depths that the device has computed with the means in the graph of PyTorch.

    The inputs are: the means (n, 3), viewmats, ks, the planes, the positions (C, n, 2), the depths (C, n), and None or
    the indices (nnz,) of the chosen ones of the C n positions and depths. The outputs are the positions (C, n, 2) or
    (nnz, 2), the depths, and the positions a second time. Render gets the positions twice, and returns the gradient
    with respect to the first ones, for the caller of rasterization(), and the negative of it for the second ones,
    because its gradient of the means includes the effect of the positions. So backward() only has to add the effect of
    other functions of the positions and depths, which most callers do not have."""

    @staticmethod
    def forward(ctx: Any, *inputs: Any, **_: Any) -> tuple[Tensor, ...]:
        means, viewmats, ks, planes, points, depths, chosen = inputs
        ctx.save_for_backward(means, viewmats, ks)
        ctx.planes, ctx.chosen = planes, chosen
        ctx.set_materialize_grads(False)
        if chosen is not None:
            points, depths = points.flatten(0, 1).index_select(0, chosen), depths.flatten().index_select(0, chosen)
        return points, depths, points.new_zeros(1).expand_as(points)

    @staticmethod
    @first_order
    def backward(ctx: Any, *v: Tensor | None) -> tuple[Any, ...]:
        v_points, v_depths, v_second = v
        if v_points is not None and v_second is not None:
            v_points = v_points + v_second
        elif v_points is None:
            v_points = v_second
        given = [part for part in (v_points, v_depths) if part is not None and bool(part.any())]
        v_means = None
        if given:
            means, viewmats, ks = ctx.saved_tensors
            with torch.enable_grad():
                means = means.detach().requires_grad_()
                points, depths = positions(means, viewmats, ks, ctx.planes)
                if ctx.chosen is not None:
                    points, depths = points.flatten(0, 1)[ctx.chosen], depths.flatten()[ctx.chosen]
            of = [(out, part) for out, part in ((points, v_points), (depths, v_depths)) if part is not None]
            (v_means,) = torch.autograd.grad([out for out, _ in of], means, [part for _, part in of])
        return (v_means,) + (None,) * 6


class Render(torch.autograd.Function):
    """Returns the image of a Drawn, which has already been rendered, with gradients. The inputs are: the Drawn, an
    AbsGrad or None, the indices of the splats that means2d contains (None for all splats), means2d twice, and the
    tensors of Gaussians. The outputs are the image and its alpha. Project describes the gradients of the positions."""

    @staticmethod
    def forward(ctx: Any, *inputs: Any, **_: Any) -> tuple[Tensor, Tensor]:
        drawn: Drawn = inputs[0]
        ctx.slot, ctx.camera, ctx.splats = drawn.slot, drawn.camera, drawn.splats
        ctx.absgrad, ctx.ids = inputs[1:3]
        ctx.save_for_backward(*inputs[5:])
        ctx.set_materialize_grads(False)
        return drawn.rgb, drawn.alpha

    @staticmethod
    @first_order
    def backward(ctx: Any, v_rgb: Tensor | None, v_alpha: Tensor | None) -> tuple[Any, ...]:
        if v_rgb is None and v_alpha is None:
            return (None,) * 10
        where = ctx.saved_tensors[0].device  # raises an error if a tensor has been changed since it was rendered
        slot: GaussianSlot = ctx.slot
        with slot.lock:
            v_all, found = slot.differentiate(ctx.splats, ctx.camera, v_rgb, v_alpha)
        v_means2d = v_all.to(where)
        if ctx.ids is not None:
            v_means2d = v_means2d.index_select(0, ctx.ids)
        if ctx.absgrad is not None:
            slot = slot_for(slot.device, len(v_all), replace(slot.form, absgrad=True))
            with slot.lock:
                sums = slot.positions_gradient(ctx.splats, ctx.camera, v_rgb, v_alpha).to(where)
            ctx.absgrad.put(sums if ctx.ids is None else sums[ctx.ids])
        return (None, None, None, v_means2d, -v_means2d, *(v.to(where) for v in found))


def _passes(
    splats: Gaussians, values: Tensor | None, form: GaussianForm, cameras: list[Camera], device: DeviceLike
) -> list[list[tuple[Drawn, Gaussians]]] | None:
    """Returns the passes of each camera. The arguments are those of render()."""
    parts: list[tuple[Tensor, GaussianForm, list[int]]] = []  # colours (n, K, 3), and indices of cameras
    everyone = list(range(len(cameras)))
    if form.degree is not None:
        parts.append((splats.colors, form, everyone))
    if values is not None:
        plain = replace(form, degree=None)
        for first in range(0, values.shape[-1], 3):
            for k, own in enumerate(values):
                parts.append((padded(own[:, first : first + 3])[:, None], plain, everyone if len(values) == 1 else [k]))
    passes: list[list[tuple[Drawn, Gaussians]]] = [[] for _ in cameras]
    for colours, shape, chosen in parts:
        part = replace(splats, colors=colours)
        drawn = draw(part, shape, [cameras[k] for k in chosen], not passes[chosen[0]], device)
        if drawn is None:
            return None
        for k, image in zip(chosen, drawn):
            passes[k].append((image, part))
    return passes


def render(
    splats: Gaussians, values: Tensor | None, form: GaussianForm, viewmats: Tensor, ks: Tensor, size: tuple[int, int],
    packed: bool, absgrad: bool, device: DeviceLike, meta: Meta,
) -> list[tuple[Tensor, Tensor]] | None:
    """Returns the image (H, W, channels) and the alpha (H, W) of each camera, without background. The channels are the
    colours from the harmonics in splats.colors, unless form.degree is None, and `values` (cameras or 1, n, D), unless
    they are None. With `absgrad`, there may be at most 3 channels. Writes into `meta` those entries of the dictionary
    of rasterization() that describe splats, except for conics. The opacities are those of the Gaussians, also with
    antialiasing. Returns None, and writes nothing, if the device does not share its memory."""
    cameras = [
        Camera.from_matrix(matrix, k, *size)
        for matrix, k in zip(viewmats.cpu().double().numpy(), ks.cpu().double().numpy())
    ]
    passes = _passes(splats, values, form, cameras, device)
    if passes is None:
        return None
    planes, count = form.planes, len(splats.means)
    computed = [images[0][0].projected for images in passes]
    points, depths, extents, strength = (stacked(list(tensors)) for tensors in zip(*computed))
    radii = _radii(extents, points, depths, strength, size, planes)
    chosen: Tensor | None = None
    counts, own = [count] * len(cameras), [None] * len(cameras)
    meta.update(batch_ids=None, camera_ids=None, gaussian_ids=None)
    if packed:
        across, down = (radii() > 0).unbind(-1)
        visible = across & down
        chosen = visible.flatten().nonzero()[:, 0]
        camera_ids = torch.div(chosen, count, rounding_mode="floor")
        gaussian_ids = chosen - count * camera_ids
        meta.update(batch_ids=torch.zeros_like(chosen), camera_ids=camera_ids, gaussian_ids=gaussian_ids)
        meta.update(radii=radii().flatten(0, 1).index_select(0, chosen))
        counts = visible.sum(-1).tolist()
        own = list(gaussian_ids.split(counts))
    points, depths, second = Project.apply(splats.means, viewmats, ks, planes, points, depths, chosen)
    if chosen is None:
        meta.compute_later("radii", radii, points, depths)
    opacities = splats.opacities.expand_as(depths) if chosen is None else splats.opacities.index_select(0, gaussian_ids)
    meta.update(means2d=points, depths=depths, opacities=opacities)
    parts, seconds = ((t.unbind() if chosen is None else t.split(counts)) for t in (points, second))
    if absgrad:
        points.absgrad = torch.zeros_like(points)
    channels = (0 if form.degree is None else 3) + (0 if values is None else values.shape[-1])
    found = []
    for k, images in enumerate(passes):
        sums = AbsGrad(points, sum(counts[:k]), 3, None) if absgrad else None
        pictures = [Render.apply(image, sums, own[k], parts[k], seconds[k], *part.tensors()) for image, part in images]
        rgb = pictures[0][0] if len(pictures) == 1 else torch.cat([picture for picture, _ in pictures], -1)
        found.append((rgb[..., :channels], pictures[0][1]))
    return found


def _radii(
    extents: Tensor, points: Tensor, depths: Tensor, opacities: Tensor, size: tuple[int, int],
    planes: tuple[float, float],
) -> Callable[[], Tensor]:
    """Returns a function that returns the radii (C, n, 2) of the ellipses in whole pixels. They are 0 for ellipses that
    are outside of the image or of the planes, or whose opacity is below LEAST_ALPHA."""
    opaque = opacities.detach() >= LEAST_ALPHA  # now, because the caller may change the opacities

    @functools.cache
    def radii() -> Tensor:
        seen = opaque & (depths >= planes[0]) & (depths <= planes[1])
        found = torch.ceil(extents)
        for side, at, radius in zip(size, points.unbind(-1), found.unbind(-1)):
            seen &= (at - side / 2).abs_() < radius + side / 2
        return found.masked_fill_(~seen[..., None], 0).to(torch.int32)

    return radii
