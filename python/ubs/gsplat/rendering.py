# SPDX-License-Identifier: Apache-2.0
"""Projection and rendering of Gaussians, with the names and arguments of gsplat 1.5."""

from __future__ import annotations

import math
from enum import Enum
from typing import Any, Callable, Literal, Optional, get_args

import torch
from torch import Tensor

from .._device import DeviceLike
from .._errors import UsageError
from .._raster import AbsGrad, SparseGradient, draw, extremes, is_finite, stacked
from .._settings import BOOLEANS
from . import fused
from .absent import refusing
from .checks import check_choice, check_tensor, number, shape_of, whole_number
from .fused import LEAST_ALPHA
from .meta import Meta
from .tiles import add_lists

CameraModel = Literal["pinhole", "ortho", "fisheye"]
RenderMode = Literal["RGB", "D", "ED", "RGB+D", "RGB+ED"]
RasterizeMode = Literal["classic", "antialiased"]
LEAST_COMPENSATION = 0.005  # smallest factor of opacities with rasterize_mode "antialiased"
FARTHEST = 1e30  # largest distance of the far plane; larger values are replaced by it
REACH = 3.33  # maximum number of standard deviations that radii cover


class RollingShutterType(Enum):
    """The order in which a camera reads its rows or columns. With GLOBAL, it reads all pixels at the same time. ubs
    only supports GLOBAL."""

    ROLLING_TOP_TO_BOTTOM = 0
    ROLLING_LEFT_TO_RIGHT = 1
    ROLLING_BOTTOM_TO_TOP = 2
    ROLLING_RIGHT_TO_LEFT = 3
    GLOBAL = 4


def _refuse(**given: Any) -> None:
    for name, value in given.items():
        off = isinstance(value, BOOLEANS) and not value
        if value is not None and not off and value is not RollingShutterType.GLOBAL:
            shown = "" if isinstance(value, Tensor) else f"={value}"
            raise UsageError(f"{name}{shown} is not supported by ubs.gsplat: remove it, or render with gsplat on CUDA")


def _planes(near: Any, far: Any) -> tuple[float, float]:
    return number("near_plane", near), min(number("far_plane", far, infinite=True), FARTHEST)


# ---- Spherical harmonics ----

# Constant factors of the real spherical harmonics of degrees 0 to 4. _harmonics() returns the functions in the order
# and with the signs of 3D Gaussian Splatting.
_C0 = math.sqrt(1 / (4 * math.pi))
_C1 = math.sqrt(3 / (4 * math.pi))
_C2 = [math.sqrt(f / math.pi) for f in (15 / 4, 5 / 16, 15 / 16)]
_C3 = [math.sqrt(f / math.pi) for f in (35 / 32, 105 / 4, 21 / 32, 7 / 16, 105 / 16)]
_C4 = [math.sqrt(f / math.pi) for f in (315 / 16, 315 / 32, 45 / 16, 45 / 32, 9 / 256, 45 / 64, 315 / 256)]


def _harmonics(degree: int, x: Tensor, y: Tensor, z: Tensor) -> list[Tensor]:
    """Returns the values of the basis functions at unit vectors."""
    found = [torch.full_like(x, _C0)]
    if degree >= 1:
        found += [-_C1 * y, _C1 * z, -_C1 * x]
    if degree >= 2:
        xx, yy, zz, xy, yz, xz = x * x, y * y, z * z, x * y, y * z, x * z
        found += [
            _C2[0] * xy,
            -_C2[0] * yz,
            _C2[1] * (3 * zz - 1),
            -_C2[0] * xz,
            _C2[2] * (xx - yy),
        ]
    if degree >= 3:
        found += [
            -_C3[0] * y * (3 * xx - yy),
            _C3[1] * xy * z,
            -_C3[2] * y * (5 * zz - 1),
            _C3[3] * z * (5 * zz - 3),
            -_C3[2] * x * (5 * zz - 1),
            _C3[4] * z * (xx - yy),
            -_C3[0] * x * (xx - 3 * yy),
        ]
    if degree >= 4:
        found += [
            _C4[0] * xy * (xx - yy),
            -_C4[1] * yz * (3 * xx - yy),
            _C4[2] * xy * (7 * zz - 1),
            -_C4[3] * yz * (7 * zz - 3),
            _C4[4] * (zz * (35 * zz - 30) + 3),
            -_C4[3] * xz * (7 * zz - 3),
            _C4[5] * (xx - yy) * (7 * zz - 1),
            -_C4[1] * xz * (xx - 3 * yy),
            _C4[6] * (xx * (xx - 3 * yy) - yy * (3 * xx - yy)),
        ]
    return found


def spherical_harmonics(
    degrees_to_use: int, dirs: Tensor, coeffs: Tensor, masks: Optional[Tensor] = None
) -> Tensor:
    """Returns colours (..., D) from coefficients (..., K, D) and directions (..., 3) of any length, for degrees 0 to 4.
    For directions (..., N, 3), coefficients may also be (N, K, D), as in gsplat 1.6. Colours are 0 where masks (...) are
    False. Unlike rasterization(), does not add 0.5 and does not clamp at 0. Tensors may be float64."""
    if isinstance(degrees_to_use, BOOLEANS) or degrees_to_use not in (0, 1, 2, 3, 4):
        raise UsageError(f"degrees_to_use={degrees_to_use} must be a whole number from 0 to 4")
    count = (int(degrees_to_use) + 1) ** 2
    shape = shape_of("dirs", dirs, 1)
    if shape_of("coeffs", coeffs, 2)[-2] < count:
        raise UsageError(f"coeffs has {coeffs.shape[-2]} bases, but degree {degrees_to_use} needs {count}")
    check_tensor("dirs", dirs, (*shape[:-1], 3), double=True)
    own = (*shape[:-1], *coeffs.shape[-2:])
    check_tensor("coeffs", coeffs, own, own[-3:], like=dirs, double=True)
    if masks is not None and tuple(masks.shape) != shape[:-1]:
        raise UsageError(f"masks have the shape {tuple(masks.shape)}, not {shape[:-1]}")
    x, y, z = torch.nn.functional.normalize(dirs, dim=-1).unbind(-1)
    basis = torch.stack(_harmonics(int(degrees_to_use), x, y, z), -1)
    # This is not a matrix product, which would lose precision in torch.autocast.
    colors: Tensor = (basis[..., None] * coeffs[..., :count, :]).sum(-2)
    return colors if masks is None else torch.where(masks[..., None], colors, torch.zeros_like(colors))


# ---- Projection ----


def _columns(quats: Tensor) -> list[Tensor]:
    """Returns the three columns (3, ...) of the rotation matrices of unit quaternions (..., 4), which begin with w."""
    w, x, y, z = quats.unbind(-1)
    columns = [
        (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
        (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
        (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)),
    ]
    return [torch.stack(column) for column in columns]


def _axes(quats: Tensor, scales: Tensor) -> Tensor:
    """Returns rotation matrices times scales (3, 3, ...). quats (..., 4) begin with w, and must not have the length 0.
    scales are (..., 3)."""
    columns = _columns(torch.nn.functional.normalize(quats, dim=-1))
    return torch.stack([column * scales[..., k] for k, column in enumerate(columns)], 1)


class _Projected:
    """The projections of Gaussians into the images of cameras. Its tensors have the shape (..., B, C, N): B batches, C
    cameras and N Gaussians."""

    def __init__(
        self,
        means: Tensor,
        axes: Tensor | None,
        covars: Tensor | None,
        viewmats: Tensor,
        ks: Tensor,
        size: tuple[int, int],
        model: str,
        planes: tuple[float, float],
        eps2d: float,
    ) -> None:
        """means (B, N, 3); axes (3, 3, B, N), or covars of the same shape; viewmats (B, C, 4, 4); ks (B, C, 3, 3)."""
        rotation = viewmats[..., :3, :3].permute(2, 3, 0, 1)[..., None]
        shift = viewmats[..., :3, 3].permute(2, 0, 1)[..., None]
        point = means.permute(2, 0, 1)[:, :, None]
        x, y, z = rotation[:, 0] * point[0] + rotation[:, 1] * point[1] + rotation[:, 2] * point[2] + shift
        self.depths = z
        self.seen = (z >= planes[0]) & (z <= planes[1]) & (z > 0)
        z = torch.where(self.seen, z, torch.ones_like(z))  # avoids infinite gradients of Gaussians that are not visible
        fx, fy, cx, cy = (ks[..., i, j, None] for i, j in ((0, 0), (1, 1), (0, 2), (1, 2)))
        if model == "pinhole":
            x, y = x / z, y / z
            self.means2d = torch.stack([fx * x + cx, fy * y + cy])
            width, height = size
            # As in the published code, the ellipse of a Gaussian whose centre is more than 15 % of the image size
            # beyond the border is computed as if the centre were at this distance.
            beyond_x, beyond_y = 0.15 * width / fx, 0.15 * height / fy
            x = torch.minimum(torch.maximum(x, -cx / fx - beyond_x), (width - cx) / fx + beyond_x)
            y = torch.minimum(torch.maximum(y, -cy / fy - beyond_y), (height - cy) / fy + beyond_y)
            first = (rotation[0] - x * rotation[2]) * (fx / z)
            second = (rotation[1] - y * rotation[2]) * (fy / z)
        elif model == "ortho":
            self.means2d = torch.stack([fx * x + cx, fy * y + cy])
            first, second = (rotation[0] * fx).expand(3, *z.shape), (rotation[1] * fy).expand(3, *z.shape)
        else:
            square = (x * x + y * y).clamp_min(1e-14)
            radius = square.sqrt()
            over = 1 / (square + z * z)
            # The angle between the point and the optical axis, divided by the distance of the point from this axis.
            bend = torch.atan2(radius, z) / radius
            self.means2d = torch.stack([fx * bend * x + cx, fy * bend * y + cy])
            slope = (z * over - bend) / square  # derivative of bend with respect to half the square
            first = (rotation[0] * (bend + x * x * slope) + rotation[1] * (x * y * slope) - rotation[2] * (x * over)) * fx
            second = (rotation[0] * (x * y * slope) + rotation[1] * (bend + y * y * slope) - rotation[2] * (y * over)) * fy
        if axes is not None:
            p = first[0] * axes[0, :, :, None] + first[1] * axes[1, :, :, None] + first[2] * axes[2, :, :, None]
            q = second[0] * axes[0, :, :, None] + second[1] * axes[1, :, :, None] + second[2] * axes[2, :, :, None]
            a, b, c = (p * p).sum(0), (p * q).sum(0), (q * q).sum(0)
            # a c - b^2 is computed as the square of p x q, which loses no precision for needle-shaped ellipses.
            cross = [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]
            sharp = cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2]
        else:
            assert covars is not None
            p = first[0] * covars[0, :, :, None] + first[1] * covars[1, :, :, None] + first[2] * covars[2, :, :, None]
            q = second[0] * covars[0, :, :, None] + second[1] * covars[1, :, :, None] + second[2] * covars[2, :, :, None]
            a, b, c = (p * first).sum(0), (p * second).sum(0), (q * second).sum(0)
            sharp = a * c - b * b
        self.a, self.b, self.c = a + eps2d, b, c + eps2d
        self.determinant = sharp + (a + c) * eps2d + eps2d * eps2d
        self.seen = self.seen & (self.determinant > 0)
        self.compensation = (sharp / self.determinant.clamp_min(1e-30)).clamp_min(LEAST_COMPENSATION**2).sqrt()

    def conics(self) -> Tensor:
        return torch.stack([self.c, -self.b, self.a], -1) / self.determinant.clamp_min(1e-30)[..., None]

    def factor(self) -> Tensor:
        """Returns the Cholesky factor of the covariance: l00, l10, l11."""
        a = torch.where(self.seen, self.a, torch.ones_like(self.a))
        l00 = a.sqrt()
        return torch.stack([l00, self.b / l00, (torch.where(self.seen, self.determinant, a) / a).sqrt()])

    def radii(self, size: tuple[int, int], opacities: Tensor | None, clip: float) -> Tensor:
        """Returns the radii (B, C, N, 2) of the ellipses in whole pixels. They are 0 for Gaussians that are not
        visible, whose opacity is below LEAST_ALPHA, or whose radii are both at most `clip`."""
        with torch.no_grad():
            reach = torch.full_like(self.a, REACH)
            seen = self.seen
            if opacities is not None:
                seen = seen & (opacities >= LEAST_ALPHA)
                reach = (2 * torch.log(opacities.clamp_min(LEAST_ALPHA) / LEAST_ALPHA)).sqrt().clamp_max(REACH)
            spread = torch.stack([self.a, self.c]).clamp_min(0).sqrt()
            radii = torch.ceil(reach * spread)
            seen = seen & (radii > clip).any(0)
            sides = radii.new_tensor(size)[:, None, None, None]
            seen = seen & ((self.means2d + radii > 0) & (self.means2d - radii < sides)).all(0)
            return torch.where(seen, radii, torch.zeros_like(radii)).permute(1, 2, 3, 0).to(torch.int32)


def _symmetric(covars: Tensor) -> Tensor:
    """Returns symmetric matrices (3, 3, B, N). `covars` (B, N, 6) contains their upper triangles. If it has the shape
    (B, N, 3, 3), its upper triangles are used."""
    six = covars if covars.dim() == 3 else covars[..., [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    return six[..., [0, 1, 2, 1, 3, 4, 2, 4, 5]].permute(2, 0, 1).reshape(3, 3, *six.shape[:2])


def _intrinsics(ks: Tensor) -> None:
    values = ks.detach().cpu().numpy()
    if (values[..., [0, 1, 2, 2], [1, 0, 0, 1]] != 0).any() or (values[..., 2, 2] != 1).any():
        raise UsageError("Ks must have the form [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]: skew is not supported")
    if not (values[..., [0, 1], [0, 1]] > 0).all():
        raise UsageError("Ks must have focal lengths above 0")


def _checked(
    means: Tensor,
    covars: Tensor | None,
    quats: Tensor | None,
    scales: Tensor | None,
    viewmats: Tensor,
    ks: Tensor,
    model: str,
    double: bool = False,
) -> tuple[int, ...]:
    """Checks the arguments of a projection, and returns the batch dimensions. `double`: see check_tensor()."""
    check_choice("camera_model", model, get_args(CameraModel))
    *batch, n, _ = shape_of("means", means, 2)
    cameras = shape_of("viewmats", viewmats, 3)[-3]
    check_tensor("means", means, (*batch, n, 3), double=double)
    check_tensor("viewmats", viewmats, (*batch, cameras, 4, 4), like=means, double=double)
    check_tensor("Ks", ks, (*batch, cameras, 3, 3), like=means, double=double)
    _intrinsics(ks)
    if covars is not None:
        check_tensor("covars", covars, (*batch, n, 3, 3), (*batch, n, 6), like=means, double=double)
    elif quats is None or scales is None:
        raise UsageError("pass either covars, or both quats and scales")
    else:
        check_tensor("quats", quats, (*batch, n, 4), like=means, double=double)
        check_tensor("scales", scales, (*batch, n, 3), like=means, double=double)
    return tuple(batch)


def _projected(
    means: Tensor,
    covars: Tensor | None,
    quats: Tensor | None,
    scales: Tensor | None,
    viewmats: Tensor,
    ks: Tensor,
    size: tuple[int, int],
    eps2d: float,
    planes: tuple[float, float],
    model: str,
) -> _Projected:
    """Joins all batch dimensions to one, and projects the Gaussians. The arguments have been checked."""
    n, cameras = means.shape[-2], viewmats.shape[-3]
    flat = math.prod(means.shape[:-2])
    axes = None
    if covars is not None:
        covars = _symmetric(covars.reshape(flat, n, *covars.shape[means.dim() - 1 :]))
    else:
        assert quats is not None and scales is not None
        axes = _axes(quats.reshape(flat, n, 4), scales.reshape(flat, n, 3))
    return _Projected(
        means.reshape(flat, n, 3), axes, covars, viewmats.reshape(flat, cameras, 4, 4),
        ks.reshape(flat, cameras, 3, 3), size, model, planes, eps2d,
    )


def fully_fused_projection(
    means: Tensor,
    covars: Optional[Tensor],
    quats: Optional[Tensor],
    scales: Optional[Tensor],
    viewmats: Tensor,
    Ks: Tensor,
    width: int,
    height: int,
    eps2d: float = 0.3,
    near_plane: float = 0.01,
    far_plane: float = 1e10,
    radius_clip: float = 0.0,
    packed: bool = False,
    sparse_grad: bool = False,
    calc_compensations: bool = False,
    camera_model: str = "pinhole",
    opacities: Optional[Tensor] = None,
) -> tuple[Any, ...]:
    """Projects Gaussians into the images of cameras with viewmats (..., C, 4, 4) and Ks (..., C, 3, 3).

    The Gaussians have means (..., N, 3), and either covars or quats (..., N, 4) and scales (..., N, 3). covars
    have the shape (..., N, 3, 3), or (..., N, 6) with only the upper triangles.

    Returns radii (..., C, N, 2), means2d (..., C, N, 2), depths (..., C, N), conics (..., C, N, 3) and compensations
    (..., C, N), which are None without calc_compensations. With `packed`, the results only contain the nnz pairs of a
    camera and a Gaussian whose radii are above 0. batch_ids, camera_ids and gaussian_ids (nnz,) then come first, and
    the other results have the shape (nnz, ...). Tensors may be float64."""
    rows: list[Tensor] = []
    if sparse_grad:
        means, covars, quats, scales = _with_sparse_gradients(packed, rows, means, covars, quats, scales)
    size = whole_number("width", width), whole_number("height", height)
    planes = _planes(near_plane, far_plane)
    eps2d, radius_clip = number("eps2d", eps2d), number("radius_clip", radius_clip)
    batch = _checked(means, covars, quats, scales, viewmats, Ks, camera_model, double=True)
    seen = _projected(means, covars, quats, scales, viewmats, Ks, size, eps2d, planes, camera_model)
    strength = None
    if opacities is not None:
        check_tensor("opacities", opacities, (*batch, means.shape[-2]), like=means, double=True)
        strength = opacities.reshape(-1, 1, means.shape[-2])
        strength = strength * seen.compensation if calc_compensations else strength
    radii = seen.radii(size, strength, radius_clip)
    found = [radii, seen.means2d.permute(1, 2, 3, 0), seen.depths, seen.conics()]
    found += [seen.compensation] if calc_compensations else []
    if packed:
        ids = torch.where((radii > 0).all(-1))
        if sparse_grad:
            rows.append(ids[2].unique())
        return (*ids, *(tensor[ids] for tensor in found), *(() if calc_compensations else (None,)))
    shaped = [tensor.reshape(*batch, *tensor.shape[1:]) for tensor in found]
    return (*shaped, *(() if calc_compensations else (None,)))


def _with_sparse_gradients(packed: bool, rows: list[Tensor], *tensors: Tensor | None) -> list[Any]:
    """Returns the tensors with sparse gradients. The first tensor is means. Before backward(), the caller appends the
    indices of the rows of the gradients to `rows`."""
    if not packed:
        raise UsageError("sparse_grad=True needs packed=True")
    if isinstance(tensors[0], Tensor) and tensors[0].dim() != 2:
        raise UsageError("with sparse_grad=True, the tensors must have no batch dimensions")
    return [SparseGradient.apply(tensor, rows) if isinstance(tensor, Tensor) else tensor for tensor in tensors]


# ---- Rendering ----


def rasterization(
    means: Tensor,
    quats: Optional[Tensor],
    scales: Optional[Tensor],
    opacities: Tensor,
    colors: Tensor,
    viewmats: Tensor,
    Ks: Tensor,
    width: int,
    height: int,
    near_plane: float = 0.01,
    far_plane: float = 1e10,
    radius_clip: float = 0.0,
    eps2d: float = 0.3,
    sh_degree: Optional[int] = None,
    packed: bool = True,
    tile_size: Optional[int] = None,
    backgrounds: Optional[Tensor] = None,
    render_mode: str = "RGB",
    sparse_grad: bool = False,
    absgrad: bool = False,
    rasterize_mode: str = "classic",
    channel_chunk: int = 32,
    distributed: bool = False,
    camera_model: str = "pinhole",
    segmented: bool = False,
    covars: Optional[Tensor] = None,
    with_ut: bool = False,
    with_eval3d: bool = False,
    radial_coeffs: Optional[Tensor] = None,
    tangential_coeffs: Optional[Tensor] = None,
    thin_prism_coeffs: Optional[Tensor] = None,
    ftheta_coeffs: Any = None,
    rolling_shutter: Any = RollingShutterType.GLOBAL,
    viewmats_rs: Optional[Tensor] = None,
    extra_signals: Optional[Tensor] = None,
    extra_signals_sh_degree: Optional[int] = None,
    *,
    return_normals: bool = False,
    global_z_order: bool = True,
    rays: Optional[Tensor] = None,
    lidar_coeffs: Any = None,
    external_distortion_coeffs: Any = None,
    ut_params: Any = None,
    renderer_config: Any = None,
    device: DeviceLike = None,
) -> tuple[Tensor, Tensor, dict[str, Any]]:
    """Renders Gaussians as seen by C cameras. All tensors get gradients, including Ks and viewmats.

    means (..., N, 3); quats (..., N, 4), w first, of any length but 0; scales (..., N, 3); opacities (..., N), 0 to 1;
    colors (..., [C,] N, D) or, with sh_degree, coefficients of spherical harmonics (..., [C,] N, K, D) or (N, K, D);
    viewmats (..., C, 4, 4) from world to camera; Ks (..., C, 3, 3); backgrounds (..., C, D); covars (..., N, 3, 3) or
    (..., N, 6) instead of quats and scales. "..." are batch dimensions. N may be 0. extra_signals are E further
    channels, which are passed in the same way as colors; the dictionary contains their images as render_extra_signals
    (..., C, height, width, E). Colours that are computed from spherical harmonics are clamped at 0, but extra_signals
    are not.

    Returns images (..., C, height, width, channels), alphas (..., C, height, width, 1) and a dictionary. The channels
    are the D colours, unless the mode is D or ED. They are followed by the depth, unless the mode is RGB. The
    dictionary has radii, depths, conics, opacities and means2d. After means2d.retain_grad(), backward() stores the
    gradient of means2d. With `packed`, batch_ids, camera_ids and gaussian_ids identify the Gaussian of each entry;
    otherwise they are None. tiles_per_gauss, isect_ids, flatten_ids and isect_offsets are those of isect_tiles() and
    isect_offset_encode() for this tile_size. These lists, radii without `packed`, conics, and opacities with
    "antialiased" are computed when they are read. Read conics and opacities before the arguments of this call are
    changed in place, for example by an optimiser.

    Each pixel contributes to the gradient of means2d. With `absgrad`, backward() also stores the sums of the absolute
    values of these contributions in the attribute means2d.absgrad (AbsGS, Ye et al. 2024). As in gsplat, each chunk of
    channel_chunk channels is summed separately. With `sparse_grad`, which requires `packed`, the gradients of means,
    quats, scales and covars are sparse tensors (COO) of the Gaussians that are in an image.

    channel_chunk, segmented and tile_size, which determine how gsplat divides its work, have no effect on pixels.
    tile_size=None means 16. return_normals, global_z_order, rays, lidar_coeffs, external_distortion_coeffs, ut_params
    and renderer_config are arguments of gsplat 1.6, which must have their default values.
    `device`, which gsplat does not have, is the ubs device that renders: a number, "gpu", or a part of a name."""
    _refuse(
        distributed=distributed, with_ut=with_ut, with_eval3d=with_eval3d,
        radial_coeffs=radial_coeffs, tangential_coeffs=tangential_coeffs, thin_prism_coeffs=thin_prism_coeffs,
        ftheta_coeffs=ftheta_coeffs, rolling_shutter=rolling_shutter, viewmats_rs=viewmats_rs,
        return_normals=return_normals, rays=rays, lidar_coeffs=lidar_coeffs,
        external_distortion_coeffs=external_distortion_coeffs, ut_params=ut_params, renderer_config=renderer_config,
    )
    if not global_z_order:
        raise UsageError("global_z_order=False is not supported by ubs.gsplat: Gaussians are sorted by their depths")
    check_choice("render_mode", render_mode, get_args(RenderMode))
    check_choice("rasterize_mode", rasterize_mode, get_args(RasterizeMode))
    rows: list[Tensor] = []
    if sparse_grad:
        means, covars, quats, scales = _with_sparse_gradients(packed, rows, means, covars, quats, scales)
    width, height = size = whole_number("width", width), whole_number("height", height)
    tile_size = 16 if tile_size is None else whole_number("tile_size", tile_size)
    channel_chunk = whole_number("channel_chunk", channel_chunk, 2**31 - 1)
    planes = _planes(near_plane, far_plane)
    eps2d, radius_clip = number("eps2d", eps2d), number("radius_clip", radius_clip)
    batch = _checked(means, covars, quats, scales, viewmats, Ks, camera_model)
    n, cameras, flat = means.shape[-2], viewmats.shape[-3], math.prod(batch)
    check_tensor("opacities", opacities, (*batch, n), like=means)
    least, most = extremes(opacities)
    if least < 0 or most > 1:
        raise UsageError("opacities must be from 0 to 1: apply torch.sigmoid to parameters without bounds")
    meta = Meta(
        width=width, height=height, tile_size=tile_size, tile_width=-(-width // tile_size),
        tile_height=-(-height // tile_size), n_batches=flat, n_cameras=cameras,
    )
    strength = opacities.reshape(flat, 1, n).expand(flat, cameras, n)
    with_colors, with_depth = "RGB" in render_mode, "D" in render_mode
    degree = sh_degree if with_colors else None
    if with_colors:
        shape_of("colors", colors, 2 if degree is None else 3)
    special = batch or radius_clip > 0 or covars is not None or extra_signals is not None or camera_model != "pinhole"
    inputs = (means, quats, scales, covars, opacities, colors, viewmats, Ks, extra_signals)
    recorded = torch.is_grad_enabled() and any(isinstance(t, Tensor) and t.requires_grad for t in inputs)
    if absgrad and recorded:
        special = special or channel_chunk < 3 or with_depth or colors.shape[-1] > 3
    if not special and fused.supports(colors if with_colors else None, scales, viewmats, Ks, degree, planes, eps2d):
        assert quats is not None and scales is not None
        values = None  # the channels (cameras or 1, n, D) that are not computed from harmonics
        if with_colors:
            check_tensor("colors", colors, tuple(colors.shape), like=means)
        if with_colors and degree is None:
            values = colors.reshape(-1, n, colors.shape[-1])
        if with_depth:
            depth = fused.in_camera(slice(2, 3), means, viewmats)
            values = depth if values is None else torch.cat([values.expand(cameras, -1, -1), depth], -1)
        antialiased = rasterize_mode == "antialiased"
        form = fused.GaussianForm(None if degree is None else int(degree), eps2d, planes, antialiased)
        splats = fused.Gaussians(means, quats, scales, opacities, colors)
        pictures = fused.render(splats, values, form, viewmats, Ks, size, packed, absgrad, device, meta)
        if pictures is not None:
            if sparse_grad:
                rows.append(meta["gaussian_ids"].unique())

            # The closure must not refer to meta, which refers to the closure: both would be freed late.
            entries: Any = (meta["camera_ids"], meta["gaussian_ids"]) if packed else ...

            def of_projection(value: Callable[[_Projected], Tensor]) -> Tensor:
                with torch.inference_mode(False), torch.set_grad_enabled(recorded):
                    seen = _projected(means, None, quats, scales, viewmats, Ks, size, eps2d, planes, camera_model)
                    return value(seen)[0][entries]

            used = (means, quats, scales, viewmats, Ks)
            meta.compute_later("conics", lambda: of_projection(_Projected.conics), *used)
            if antialiased:
                meta.compute_later(
                    "opacities", lambda: of_projection(lambda seen: opacities * seen.compensation), opacities, *used
                )
            add_lists(meta, batch)
            channels = pictures[0][0].shape[-1]
            grounds = _grounds(backgrounds, means, batch, cameras, channels, 0, render_mode)
            return *_blended(pictures, grounds, render_mode, means, (cameras, height, width, channels)), meta
    seen = _projected(means, covars, quats, scales, viewmats, Ks, size, eps2d, planes, camera_model)
    if rasterize_mode == "antialiased":
        strength = strength * seen.compensation
    radii = seen.radii(size, strength, radius_clip)
    visible = (radii > 0).all(-1)
    ids = torch.where(visible) if packed else None
    if sparse_grad and ids is not None:
        rows.append(ids[2].unique())

    def chosen(tensor: Tensor) -> Tensor:
        return tensor if ids is None else tensor[ids]

    means2d = chosen(seen.means2d.permute(1, 2, 3, 0))
    if ids is None:
        means2d = means2d.reshape(*batch, cameras, n, 2)
    depths, radii, strength, conics = (chosen(t) for t in (seen.depths, radii, strength, seen.conics()))
    factor = seen.factor() if ids is None else seen.factor()[(slice(None), *ids)]
    bands: list[Tensor] = []
    if "RGB" in render_mode:
        shaded = _shaded("colors", means, colors, viewmats, sh_degree, batch, cameras, ids, visible)
        bands.append(shaded if sh_degree is None else shaded.clamp_min(0))
    extra = 0
    if extra_signals is not None:
        degree = extra_signals_sh_degree
        bands.append(_shaded("extra_signals", means, extra_signals, viewmats, degree, batch, cameras, ids, visible))
        extra = bands[-1].shape[-1]
    if "D" in render_mode:
        bands.append(depths[..., None])
    values = torch.cat(bands, -1) if len(bands) > 1 else bands[0]
    if absgrad:
        means2d.absgrad = means2d.new_zeros(means2d.shape)
    grounds = _grounds(backgrounds, means, batch, cameras, values.shape[-1], extra, render_mode)

    # Sizes of the parts of the packed arrays that belong to each image.
    counts = [n] * (flat * cameras) if ids is None else visible.sum(-1).reshape(-1).tolist()
    order = torch.where(visible, seen.depths.detach(), -torch.ones_like(visible, dtype=torch.float32))
    parts = [means2d.reshape(-1, 2), factor.reshape(3, -1), chosen(order).reshape(-1)]
    parts += [values.reshape(-1, values.shape[-1]), strength.reshape(-1)]
    split = [part.split(counts, dim=int(k == 1)) for k, part in enumerate(parts)]
    pictures = []
    for k in range(flat * cameras):
        ground = None if grounds is None else grounds[k]
        sums = AbsGrad(means2d, sum(counts[:k]), channel_chunk, ground) if absgrad else None
        pictures.append(draw(size, device, sums, *(part[k] for part in split)))
    shape = (*batch, cameras, height, width, values.shape[-1])
    colours, alphas = _blended(pictures, grounds, render_mode, means, shape)

    def out(tensor: Tensor) -> Tensor:
        return tensor if ids is not None else tensor.reshape(*batch, *tensor.shape[1:])

    meta.update(zip(("batch_ids", "camera_ids", "gaussian_ids"), ids or (None, None, None)))
    meta.update(radii=out(radii), means2d=means2d, depths=out(depths), conics=out(conics), opacities=out(strength))
    add_lists(meta, batch)
    if extra_signals is not None:
        last = colours.shape[-1] - ("D" in render_mode)
        meta["render_extra_signals"] = colours[..., last - extra : last]
        colours = torch.cat([colours[..., : last - extra], colours[..., last:]], -1)
    return colours, alphas, meta


def _blended(
    pictures: list[tuple[Tensor, Tensor]], grounds: list[Tensor] | None, mode: str, like: Tensor, shape: tuple[int, ...]
) -> tuple[Tensor, Tensor]:
    """Blends images (H, W, D) and their alphas (H, W) with backgrounds (D,). In the modes with ED, divides the last
    channel, which is the depth, by alpha. `shape` is the shape of all images together. `like` is any tensor with the
    type and the device of the images."""
    alone = (*shape[:-1], 1)
    if not pictures:
        return like.new_zeros(shape), like.new_zeros(alone)
    images, alphas = [], []
    for k, (image, weight) in enumerate(pictures):
        alpha = weight[..., None]
        if grounds is not None:
            image = image + (1 - alpha) * grounds[k]
        if "ED" in mode:
            image = torch.cat([image[..., :-1], image[..., -1:] / alpha.clamp_min(1e-10)], -1)
        images.append(image)
        alphas.append(alpha)
    return stacked(images).reshape(shape), stacked(alphas).reshape(alone)


def _shaded(
    name: str,
    means: Tensor,
    colors: Tensor,
    viewmats: Tensor,
    degree: int | None,
    batch: tuple[int, ...],
    cameras: int,
    ids: tuple[Tensor, ...] | None,
    visible: Tensor,
) -> Tensor:
    """Returns the colours (B, C, N, D) of all Gaussians, or the colours (nnz, D) of the Gaussians that `ids` selects.
    They are not clamped. `name` is the name of the argument `colors` in error messages."""
    n, flat = means.shape[-2], math.prod(batch)
    shape = shape_of(name, colors, 2 if degree is None else 3)
    if degree is not None and len(shape) == 3 and batch:  # the same colours for the whole batch
        colors = colors.expand(*batch, *shape)
    last = shape[-1:] if degree is None else shape[-2:]
    _check_channels(name, shape, degree)
    check_tensor(name, colors, (*batch, n, *last), (*batch, cameras, n, *last), like=means)
    own = colors.dim() == len(batch) + 2 + len(last)  # each camera has its own colours
    colors = colors.reshape(flat, cameras if own else 1, n, *last)
    if ids is not None:
        colors = colors[ids] if own else colors[:, 0][ids[0], ids[2]]
    else:
        colors = colors.expand(flat, cameras, n, *last)
    if degree is None:
        return colors
    centres = _centres(viewmats).reshape(flat, cameras, 1, 3)
    points = means.reshape(flat, 1, n, 3)
    if ids is not None:
        dirs = points[:, 0][ids[0], ids[2]] - centres[:, :, 0][ids[0], ids[1]]
        return spherical_harmonics(degree, dirs, colors) + 0.5
    return spherical_harmonics(degree, points - centres, colors, visible) + 0.5


def _check_channels(name: str, shape: tuple[int, ...], degree: Any) -> None:
    """Checks the last dimensions of colours. `degree` is that of the argument sh_degree."""
    setting = "sh_degree" if name == "colors" else f"{name}_sh_degree"
    if shape[-1] == 0:
        raise UsageError(f"{name} has the shape {shape}: there must be at least one channel")
    if degree is None:
        return
    if isinstance(degree, BOOLEANS) or degree not in (0, 1, 2, 3, 4):
        raise UsageError(f"{setting}={degree} must be a whole number from 0 to 4, or None")
    if shape[-2] < (degree + 1) ** 2:
        raise UsageError(
            f"{name} has the shape {shape}, but {setting}={degree} needs {(int(degree) + 1) ** 2} coefficients: "
            f"(..., {(int(degree) + 1) ** 2}, channels)"
        )


def _centres(viewmats: Tensor) -> Tensor:
    """Returns the centres (..., 3) of cameras in the world, which are in the last columns of the inverse matrices.
    torch.inverse would compute the gradient of viewmats with matrix products, which lose precision in torch.autocast.
    Raises UsageError if a matrix has no inverse."""
    a, b, c, last = viewmats[..., :3].unbind(-2)
    x, y, z, one = viewmats[..., 3, None].unbind(-2)
    columns = torch.linalg.cross(b, c), torch.linalg.cross(c, a), torch.linalg.cross(a, b)
    determinant = (a * columns[0]).sum(-1, keepdim=True)
    centres = -(x * columns[0] + y * columns[1] + z * columns[2]) / determinant
    scale = one + (last * centres).sum(-1, keepdim=True)  # 1, because the last row of a viewmat is 0 0 0 1
    centres = centres / scale
    if not is_finite(centres):
        raise UsageError("viewmats contains a matrix without an inverse: pass matrices from world to camera")
    return centres


def _grounds(
    backgrounds: Tensor | None, means: Tensor, batch: tuple[int, ...], cameras: int, channels: int, extra: int, mode: str
) -> list[Tensor] | None:
    """Returns the background of each image, or None if there are no backgrounds. The background of depths is 0, and so
    is that of extra signals if `backgrounds` has no channels for them."""
    if backgrounds is None or "RGB" not in mode:
        return None
    wanted = channels - ("D" in mode)
    check_tensor("backgrounds", backgrounds, (*batch, cameras, wanted), (*batch, cameras, wanted - extra), like=means)
    if channels > backgrounds.shape[-1]:
        backgrounds = torch.nn.functional.pad(backgrounds, (0, channels - backgrounds.shape[-1]))
    return list(backgrounds.reshape(-1, channels))


def __getattr__(name: str) -> Any:
    return refusing(__name__, name)
