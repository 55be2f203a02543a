# SPDX-License-Identifier: Apache-2.0
"""The fast implementation of rasterization(), in which the device projects the Gaussians and evaluates their spherical
harmonics.

It supports the calls that most trainers make: the Gaussians have quaternions and scales, all cameras share spherical
harmonics up to degree 3, and the viewmats and Ks of the pinhole cameras need no gradients. supports() and
rasterization() test all conditions. PyTorch computes the positions in the image a second time, so that means2d is a
tensor with a gradient. The device returns the gradient with respect to these positions, and the gradients of the
parameters for fixed positions; PyTorch adds the part that goes through the positions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from .._data import Camera
from .._device import DeviceLike
from .._raster import CHUNK, Form, Slot, first_order, scale_inverse, slot_for
from .._settings import BOOLEANS

LEAST_ALPHA = 1 / 255  # Gaussians with a lower opacity are not rendered
LEAST_SCALE = 1e-15  # scales must be larger, because the softplus of the kernels has no gradient for smaller ones
NOT_A_ROTATION = 2e-6  # a matrix R counts as a rotation if all entries of R R^T - I are below this value


@dataclass
class Gaussians:
    means: Tensor  # (n, 3)
    quats: Tensor  # (n, 4)
    scales: Tensor  # (n, 3), above 0
    opacities: Tensor  # (n,)
    colors: Tensor  # (n, K, 3)
    degree: int

    def tensors(self) -> tuple[Tensor, ...]:
        return self.means, self.quats, self.scales, self.opacities, self.colors

    def values(self) -> dict[str, Tensor]:
        """Returns the raw parameters of the splats by name. Their last dimension is the number of splats."""
        used = self.colors[:, : (self.degree + 1) ** 2].permute(2, 1, 0)
        opacities = self.opacities.clamp(1e-8, 1 - 2.0**-24)
        found = {
            "xyz": self.means.T, "sh0": used[:, 0], "opacity": torch.logit(opacities)[None],
            "scale": scale_inverse(self.scales).T, "rotation": self.quats.T,
        }
        return {**found, "sh_rest": used[:, 1:]} if self.degree > 0 else found

    def gradients(self, v: dict[str, Tensor]) -> tuple[Tensor, ...]:
        """Converts the gradients of the raw parameters to gradients of tensors(), and returns these."""
        opacities = self.opacities.clamp(1e-8, 1 - 2.0**-24)
        count = (self.degree + 1) ** 2
        shape = self.colors.shape  # new tensors with this shape are contiguous, but colors may have other strides
        v_colors = self.colors.new_empty(shape) if count == shape[1] else self.colors.new_zeros(shape)
        flat = v_colors.view(len(v_colors), -1)
        flat[:, :3] = v["sh0"].T
        if self.degree > 0:
            rest = v["sh_rest"].unflatten(0, (3, count - 1)).transpose(0, 1)  # coefficient by coefficient, as in colors
            for first in range(0, len(flat), CHUNK):
                rows = rest[..., first : first + CHUNK].reshape(3 * (count - 1), -1)
                flat[first : first + CHUNK, 3 : 3 * count] = rows.T
        v_scales = v["scale"].T / -torch.expm1(-self.scales)
        v_opacities = v["opacity"][0] / (opacities * (1 - opacities))
        return v["xyz"].T.contiguous(), v["rotation"].T.contiguous(), v_scales, v_opacities, v_colors


@dataclass
class Drawn:
    """The rendered image of one camera."""

    rgb: Tensor  # (H, W, 3)
    alpha: Tensor  # (H, W)
    extents: Tensor  # (n, 2), half the size of the rectangle around each ellipse [px]
    slot: Slot
    camera: Camera
    holder: object  # identifies the Gaussians on the device


def supports(
    colors: Any, scales: Tensor | None, viewmats: Tensor, ks: Tensor, degree: int | None, planes: tuple[float, float],
    eps2d: float,
) -> bool:
    """Returns whether render() supports these arguments of rasterization(), if they have no batch dimensions. The
    caller has checked all arguments except colors."""
    if isinstance(degree, BOOLEANS) or degree not in (0, 1, 2, 3) or not isinstance(colors, Tensor):
        return False
    if scales is None or len(viewmats) == 0:
        return False
    if len(scales) == 0 or not bool((scales > LEAST_SCALE).all()):
        return False
    if colors.dim() != 3 or len(colors) != len(scales) or colors.shape[1] < (degree + 1) ** 2 or colors.shape[2] != 3:
        return False
    if torch.is_grad_enabled() and (viewmats.requires_grad or ks.requires_grad):
        return False
    if not (1e-6 <= planes[0] < planes[1] <= 1e30 and eps2d <= 100):
        return False
    turns = viewmats[:, :3, :3].double()
    apart = turns @ turns.transpose(1, 2) - torch.eye(3, dtype=torch.float64, device=turns.device)
    rigid = bool((apart.abs() < NOT_A_ROTATION).all()) and bool((torch.linalg.det(turns) > 0).all())
    last = viewmats.new_tensor([0, 0, 0, 1])
    return rigid and bool((viewmats[:, 3] == last).all())


def draw(
    splats: Gaussians, viewmats: Tensor, ks: Tensor, size: tuple[int, int], planes: tuple[float, float], eps2d: float,
    device: DeviceLike,
) -> list[Drawn] | None:
    """Renders the image of each camera. Returns None if the device does not share its memory."""
    form = Form("gaussian", degree=splats.degree, eps2d=eps2d, planes=planes)
    slot, where = slot_for(device, len(splats.means), form), splats.means.device
    if not slot.shared:
        return None
    recorded = torch.is_grad_enabled() and any(t.requires_grad for t in splats.tensors())
    holder, found = object(), []
    with torch.no_grad(), slot.lock:
        slot.put(holder, splats.values())
        for matrix, k in zip(viewmats.cpu().double().numpy(), ks.cpu().double().numpy()):
            camera = Camera.from_matrix(matrix, k, *size)
            rgb, alpha = slot.draw(camera, where, recorded)
            found.append(Drawn(rgb, alpha, slot.extents().to(where, copy=True), slot, camera, holder))
    return found


def means2d(means: Tensor, viewmats: Tensor, ks: Tensor, planes: tuple[float, float]) -> tuple[Tensor, Tensor]:
    """Returns the positions (C, n, 2) in the images, and the depths (C, n)."""
    x, y, z = means[:, 0:1], means[:, 1:2], means[:, 2:3]
    columns = viewmats[:, None, :3].unbind(-1)  # not a matrix product, which would lose precision in torch.autocast
    points = x * columns[0] + y * columns[1] + z * columns[2] + columns[3]
    depths = points[..., 2]
    seen = (depths >= planes[0]) & (depths <= planes[1])
    # The depth 1 avoids infinite gradients of Gaussians that are not visible.
    over = 1 / torch.where(seen, depths, torch.ones_like(depths))
    focal = ks[:, None, [0, 1], [0, 1]]
    return focal * points[..., :2] * over[..., None] + ks[:, None, [0, 1], [2, 2]], depths


class Render(torch.autograd.Function):
    """Returns the image of a Drawn, which has already been rendered, with gradients. The inputs are: the Drawn, the
    degree of the spherical harmonics, the indices of the splats that means2d contains (None for all splats), means2d,
    and the tensors of Gaussians. The outputs are the image and its alpha."""

    @staticmethod
    def forward(ctx: Any, *inputs: Any, **_: Any) -> tuple[Tensor, Tensor]:
        drawn: Drawn = inputs[0]
        ctx.slot, ctx.camera, ctx.holder = drawn.slot, drawn.camera, drawn.holder
        ctx.degree, ctx.ids = inputs[1:3]
        ctx.save_for_backward(*inputs[4:])
        ctx.set_materialize_grads(False)
        return drawn.rgb, drawn.alpha

    @staticmethod
    @first_order
    def backward(ctx: Any, v_rgb: Tensor | None, v_alpha: Tensor | None) -> tuple[Any, ...]:
        if v_rgb is None and v_alpha is None:
            return (None,) * 9
        means, quats, scales, opacities, colors = ctx.saved_tensors
        splats = Gaussians(means, quats, scales, opacities, colors, ctx.degree)
        slot: Slot = ctx.slot
        with slot.lock:
            if slot.holds is not ctx.holder:
                slot.put(ctx.holder, splats.values())
            v = slot.differentiate(ctx.camera, v_rgb, v_alpha)
            v = {name: tensor.to(splats.means.device) for name, tensor in v.items()}
            v_means2d = v["means2d"] if ctx.ids is None else v["means2d"][ctx.ids]
            found = splats.gradients(v)
        return (None, None, None, v_means2d, *found)


def render(
    splats: Gaussians, viewmats: Tensor, ks: Tensor, size: tuple[int, int], planes: tuple[float, float], eps2d: float,
    packed: bool, device: DeviceLike, meta: dict[str, Any],
) -> list[tuple[Tensor, Tensor]] | None:
    """Returns the image (H, W, 3) and the alpha (H, W) of each camera, without background. Writes into `meta` those
    entries of the dictionary of rasterization() that describe splats, except for conics. Returns None, and writes
    nothing, if the device does not share its memory."""
    drawn = draw(splats, viewmats, ks, size, planes, eps2d, device)
    if drawn is None:
        return None
    points, depths = means2d(splats.means, viewmats, ks, planes)
    opacities = splats.opacities.expand_as(depths)
    radii = _radii(torch.stack([image.extents for image in drawn]), points, depths, opacities, size, planes)
    ids: tuple[Tensor, ...] | None = torch.where((radii > 0).all(-1)) if packed else None
    if ids is None:
        meta.update(batch_ids=None, camera_ids=None, gaussian_ids=None)
        own: list[Tensor | None] = [None] * len(drawn)
        parts = points.unbind()
    else:
        points, depths, opacities, radii = (t[ids] for t in (points, depths, opacities, radii))
        meta.update(batch_ids=torch.zeros_like(ids[0]), camera_ids=ids[0], gaussian_ids=ids[1])
        counts = torch.bincount(ids[0], minlength=len(drawn)).tolist()
        own, parts = list(ids[1].split(counts)), points.split(counts)
    meta.update(radii=radii, means2d=points, depths=depths, opacities=opacities)
    splits = zip(drawn, own, parts)
    return [Render.apply(image, splats.degree, some, part, *splats.tensors()) for image, some, part in splits]


def _radii(
    extents: Tensor, points: Tensor, depths: Tensor, opacities: Tensor, size: tuple[int, int],
    planes: tuple[float, float],
) -> Tensor:
    """Returns the radii (C, n, 2) of the ellipses in whole pixels. They are 0 for ellipses that are outside of the
    image or of the planes, or whose opacity is below LEAST_ALPHA."""
    with torch.no_grad():
        seen = (depths >= planes[0]) & (depths <= planes[1]) & (opacities >= LEAST_ALPHA)
        radii = torch.ceil(torch.where(seen[..., None], extents, torch.zeros_like(extents)))
        seen = seen & ((points + radii > 0) & (points - radii < radii.new_tensor(size))).all(-1)
        return torch.where(seen[..., None], radii, torch.zeros_like(radii)).to(torch.int32)
