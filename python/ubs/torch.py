# SPDX-License-Identifier: Apache-2.0
"""Provides rendering as a differentiable function of PyTorch, for training with the optimisers of PyTorch and any loss.

    import ubs, ubs.torch
    splats = ubs.torch.Splats(ubs.Model.initial(data, dim=6))
    rgb, alpha = splats(camera)                      # (H, W, 3), (H, W)
    my_loss(rgb, alpha).backward()

The module also provides the method as functions of tensors. render() takes raw parameters. condition() and
condition_direct() convert splats of N dimensions to splats in 3D space. rasterize() renders projected splats, so that a
program can use its own code for the projection and for everything before it.

Any device of ubs can render. If tensors are in the memory of the device that renders, they stay there (DLPack). This is
possible with CUDA, and on CPUs with PoCL. Other tensors are copied through host memory. Colours, alpha and depth have
gradients with respect to every raw parameter, and with respect to the camera if it is passed as tensors. Gradients
include the path through the view direction, because the rendered image depends on it. `ubs train` ignores this path.
The setting query_grad=False ignores it here, too.
Rendering has no second-order gradients: computing its gradient with create_graph=True raises UsageError. All splats of
a model must have the same dimension."""

from __future__ import annotations

import threading
from typing import Any, Mapping, Sequence, cast

import numpy as np
import torch
from torch import Tensor

from ._abi import integer
from ._data import Camera, FloatArray, checked_camera
from ._device import DeviceLike, opened
from ._drawing import VIEW_SHAPES, Drawing, check_view_shape, seen, v_view
from ._errors import NumericalError, UsageError
from ._falloff import Falloff, as_falloff
from ._model import Model
from ._raster import draw as _draw_ellipses
from ._raster import extremes, first_order, gradients_on_device, is_finite
from ._settings import as_text

__all__ = ["Splats", "condition", "condition_direct", "rasterize", "render"]


def _checked(tensor: Tensor) -> Tensor:
    if tensor.dtype != torch.float32:
        raise UsageError(f"a parameter has the type {tensor.dtype}: ubs.torch requires float32")
    return tensor.detach()


def _array(tensor: Tensor) -> FloatArray:
    array: FloatArray = _checked(tensor).cpu().numpy()
    return array


def _is_shared(drawing: Drawing, tensor: Tensor) -> bool:
    """Returns whether the tensor is in the memory of the device that renders."""
    kind, number = tensor.__dlpack_device__()
    return drawing.place == (int(kind), number)


def _shared(drawing: Drawing, name: str, size: tuple[int, int] = (0, 0)) -> Tensor:
    tensor: Tensor = cast(Any, torch).from_dlpack(drawing.renderer.array(name, size=size))
    return tensor


def _copy(drawing: Drawing, name: str) -> Tensor:
    return _shared(drawing, name).clone(memory_format=torch.contiguous_format)


def _wait(tensor: Tensor) -> None:
    if tensor.is_cuda:
        torch.cuda.current_stream(tensor.device).synchronize()


def _put(drawing: Drawing, parameters: Sequence[Tensor]) -> None:
    drawing.resize([tensor.shape for tensor in parameters])
    if not _is_shared(drawing, parameters[0]):
        drawing.put([_array(tensor) for tensor in parameters])
        return
    rows = _shared(drawing, "parameters")
    parts = rows.split([tensor.shape[1] for tensor in parameters])
    for part, tensor in zip(parts, parameters):
        part.copy_(_checked(tensor).T)
    if not is_finite(rows):
        names = [name for name, tensor in zip(drawing.names, parameters) if not is_finite(tensor)]
        raise NumericalError(f"parameters have values that are not finite: {', '.join(names)}")
    _wait(rows)


def _draw(drawing: Drawing, camera: Camera, parameters: Sequence[Tensor], reason: object) -> tuple[Tensor, ...]:
    """Renders an image. `reason` identifies the image for _differentiate(). If it is None, the image will not be
    differentiated."""
    _put(drawing, parameters)
    if not _is_shared(drawing, parameters[0]):
        image = drawing.renderer.render(camera, for_gradient=reason is not None)
        drawing.kept = reason
        pictures = (image.rgb, image.alpha) if image.depth is None else (image.rgb, image.alpha, image.depth)
        return tuple(torch.from_numpy(picture).to(parameters[0].device) for picture in pictures)
    drawing.renderer.draw(camera, for_gradient=reason is not None)
    drawing.kept = reason
    pair = (_copy(drawing, "rgb"), 1 - _shared(drawing, "transmittance"))
    return (*pair, _copy(drawing, "depth")) if drawing.depth else pair


def _differentiate(
    drawing: Drawing, camera: Camera, parameters: Sequence[Tensor], v: Sequence[Tensor | None], reason: object
) -> list[Tensor]:
    """Returns the gradients of each parameter. They are contiguous, because transposed gradients slow down later
    operations. If the device no longer has the data of the image that `reason` identifies, renders it again."""
    if drawing.kept is not reason:
        _put(drawing, parameters)
        drawing.renderer.draw(camera, for_gradient=True)
    drawing.kept = None
    shared = _is_shared(drawing, parameters[0])
    given: Sequence[Any]
    if shared:
        given = gradients_on_device(drawing.renderer, camera, *v)
    else:
        given = [None if t is None else _array(t) for t in v]
    found = drawing.renderer.vjp(None, *given, parameters=not shared)
    if all(t is None for t in v[1:]):  # gradients of alpha and depth overwrite the image
        drawing.kept = reason
    if not shared:
        where = parameters[0].device
        return [torch.from_numpy(found[0][name]).contiguous().to(where) for name in drawing.names]
    rows = _shared(drawing, "gradient")
    if not bool(torch.isfinite(rows).all()):
        raise NumericalError("a gradient of the parameters is not finite")
    parts = rows.split([tensor.shape[1] for tensor in parameters])
    return [part.T.clone(memory_format=torch.contiguous_format) for part in parts]


def _values(tensor: Tensor | None, what: str) -> Any:
    if tensor is None:
        return None
    if not isinstance(tensor, Tensor):
        raise UsageError(f"{what} must be a torch.Tensor, not {type(tensor).__name__}")
    check_view_shape(what, tuple(tensor.shape))
    return tensor.detach().double().cpu().numpy()


def _view_values(view: Sequence[Tensor | None]) -> list[Any]:
    return [_values(tensor, what) for tensor, what in zip(view, VIEW_SHAPES)]


class _Render(torch.autograd.Function):
    """Renders a view. The inputs are: whether gradients are recorded; a Drawing; a Camera; the pose, the intrinsics and
    the time that replace those of the camera, or None for each; and the tensors of the parameters."""

    @staticmethod
    def forward(ctx: Any, *inputs: Any, **_: Any) -> tuple[Tensor, ...]:
        recorded, drawing, camera, *ctx.view = inputs[:6]
        parameters: tuple[Tensor, ...] = inputs[6:]
        ctx.drawing, ctx.camera = drawing, seen(camera, *_view_values(ctx.view))
        ctx.save_for_backward(*parameters)
        ctx.set_materialize_grads(False)
        ctx.reason = object() if recorded and any(ctx.needs_input_grad) else None
        with drawing.lock:
            return _draw(drawing, ctx.camera, parameters, ctx.reason)

    @staticmethod
    @first_order
    def backward(ctx: Any, *v_pictures: Tensor | None) -> tuple[Any, ...]:
        drawing: Drawing = ctx.drawing
        view: list[Tensor | None] = [None, None, None]
        wanted = any(t is not None and t.requires_grad for t in ctx.view)
        with drawing.lock:
            found = _differentiate(drawing, ctx.camera, ctx.saved_tensors, v_pictures, ctx.reason)
            camera = drawing.renderer.camera_gradient() if wanted else None
        if camera is not None:
            for k, (given, v) in enumerate(zip(ctx.view, v_view(_view_values(ctx.view), camera))):
                if given is not None:
                    view[k] = torch.as_tensor(v, dtype=given.dtype, device=given.device)
        return (None, None, None, *view, *found)


def _rendered(
    drawing: Drawing,
    camera: Camera,
    pose: Tensor | None,
    intrinsics: Tensor | None,
    time: Tensor | None,
    tensors: Sequence[Tensor],
) -> tuple[Tensor, ...]:
    """Renders splats with these parameters, of which there may be none."""
    view = checked_camera(camera), pose, intrinsics, time
    if tensors[0].shape[:1] != (0,):
        pictures: tuple[Tensor, ...] = _Render.apply(torch.is_grad_enabled(), drawing, *view, *tensors)
        return pictures
    # A model must have at least one splat, so render a single transparent splat. Add the sum over the empty parameters,
    # which is 0, so that the parameters get gradients.
    none = cast(Tensor, sum(tensor.sum() for tensor in tensors))
    transparent = [tensor.new_full((1, *tensor.shape[1:]), -1e3 if name == "opacity" else 0.0)
                   for name, tensor in zip(drawing.names, tensors)]
    with torch.no_grad():
        empty: tuple[Tensor, ...] = _Render.apply(False, drawing, *view, *transparent)
    return tuple(picture + none for picture in empty)


class Splats(torch.nn.Module):
    """A module with the raw parameters of a model. It has one torch.nn.Parameter (splats, values per splat) for each
    name in Model.parameters, such as `xyz`. These may be replaced by parameters for a different number of splats. With
    `depth`, the module also returns depth. `settings` are passed to ubs.Renderer: its settings, such as background, and
    its argument `falloff`. The module can be copied and saved.

    Gradients include the path through the view direction to the positions of the splats, because the rendered image
    depends on it. `ubs train` and the published method ignore this path. The setting query_grad=False ignores it here,
    too."""

    def __init__(self, model: Model, device: DeviceLike = None, *, depth: bool = False, **settings: Any) -> None:
        super().__init__()
        self._drawing = Drawing(model, device, depth, settings)
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
        """Renders a view. Returns rgb (H, W, 3), which is not clamped, alpha (H, W), and, if the module was created
        with depth=True, depth (H, W).

        The tensors `pose`, `intrinsics` and `time` replace the values of the camera, and get gradients. The shape of
        pose is (3, 4) or (4, 4). intrinsics are fx, fy, cx and cy (4,), or a matrix (3, 3). If the matrix of the pose
        is not exactly a rotation, the nearest rotation is used for the image and its gradient, so an optimiser can
        change the entries of the matrix independently. Raises DataError if a singular value of the rotation matrix is
        not between 0.9 and 1.1."""
        return _rendered(self._drawing, camera, pose, intrinsics, time, self._tensors())

    def _load_from_state_dict(self, state_dict: dict[str, Any], prefix: str, *rest: Any) -> None:
        """Lets load_state_dict() load parameters of another number of splats, as density control creates them. It then
        replaces the parameters, so optimisers must be created afterwards."""
        given = {name: state_dict.get(prefix + name) for name in self._drawing.names}
        counts = {len(tensor) if isinstance(tensor, Tensor) and tensor.dim() == 2 else -1 for tensor in given.values()}
        count = counts.pop()
        if not counts and count >= 0:  # otherwise the sizes do not fit, which PyTorch reports
            for name in given:
                own: torch.nn.Parameter = getattr(self, name)
                if len(own) != count:
                    room = own.detach().new_empty((count, own.shape[1]))
                    setattr(self, name, torch.nn.Parameter(room, requires_grad=own.requires_grad))
        super()._load_from_state_dict(state_dict, prefix, *rest)

    def model(self) -> Model:
        """Returns a copy of the model with the current values of the parameters."""
        with self._drawing.lock:
            self._drawing.put([_array(tensor) for tensor in self._tensors()])
            return self._drawing.model.copy()


_KEPT = 4  # number of renderers that render() keeps
_kept: dict[Any, Drawing] = {}
_kept_lock = threading.Lock()


def render(
    parameters: Mapping[str, Tensor],
    camera: Camera,
    *,
    dim: int = 6,
    depth: bool = False,
    pose: Tensor | None = None,
    intrinsics: Tensor | None = None,
    time: Tensor | None = None,
    device: DeviceLike = None,
    falloff: Falloff | str | None = None,
    **settings: Any,
) -> tuple[Tensor, ...]:
    """Renders splats from their raw parameters. The number of splats may differ between calls, and may be 0.

    parameters: float32 tensors (splats, values per splat) with the names and widths of ubs.Model.empty(dim, 1,
    **settings).parameters; their activations are part of rendering (docs/method.md 1.1). settings: those of
    ubs.Model.empty(), such as conditioning="direct", kernel="gaussian", colour="sh3", background=(1, 1, 1), and
    query_grad=False, which ignores gradients through the view direction. pose, intrinsics, time: see
    Splats.forward(). falloff: see ubs.Renderer.

    Returns rgb (H, W, 3), which is not clamped, alpha (H, W), and, with depth=True, depth (H, W)."""
    given = dict(parameters)
    of_renderer = {key: settings.pop(key) for key in ("query_grad", "raster", "math") if key in settings}
    where = opened(device)
    own = None if falloff is None else as_falloff(falloff)
    key = (where, dim, depth, own, *sorted((k, as_text(v)) for k, v in {**settings, **of_renderer}.items()))
    of_renderer["falloff"] = own
    with _kept_lock:
        drawing = _kept.pop(key, None) or Drawing(Model.empty(dim, 1, **settings), where, depth, of_renderer)
        _kept[key] = drawing  # the most recently used renderer is at the end
        while len(_kept) > _KEPT:
            _kept.pop(next(iter(_kept)))
    if set(given) != set(drawing.names):
        raise UsageError(f"the parameters are {', '.join(given)}, but this variant has {', '.join(drawing.names)}")
    tensors = [given[name] for name in drawing.names]
    return _rendered(drawing, camera, pose, intrinsics, time, tensors)


def _check_tensor(name: str, tensor: Tensor, shape: tuple[int, ...], like: Tensor) -> None:
    if not isinstance(tensor, Tensor) or tensor.dtype != like.dtype or tensor.device != like.device:
        raise UsageError(f"{name} must be a tensor of {like.dtype} on {like.device}")
    if tuple(tensor.shape) != shape:
        raise UsageError(f"{name} has the shape {tuple(tensor.shape)}, not {shape}")
    if not is_finite(tensor):
        raise NumericalError(f"{name} has values that are not finite")


def rasterize(
    means2d: Tensor,
    covs2d: Tensor,
    depths: Tensor,
    colors: Tensor,
    opacities: Tensor,
    betas: Tensor | None = None,
    *,
    width: int,
    height: int,
    background: Tensor | None = None,
    device: DeviceLike = None,
    falloff: Falloff | str | None = None,
) -> tuple[Tensor, Tensor]:
    """Rasterises n projected splats: sorts them by depth and composites them front to back (docs/method.md 2.6).

    means2d (n, 2): centres in pixels; the centre of the first pixel is (0.5, 0.5). covs2d (n, 2, 2): positive definite,
    in square pixels, including any desired blur. depths (n,): the order; splats with a depth of 0 or less are not
    rendered. colors (n, D), any number of channels. opacities (n,), 0 to 1.

    betas (n,): positive exponents of Beta kernels. The alpha of a splat at a pixel is opacity * (1 - r)^beta if r < 1,
    and 0 otherwise. r is d^T covs2d^-1 d, and d is the vector from the centre to the pixel. If betas is None, the
    splats are Gaussians: alpha is opacity * exp(-r / 2), and values below 1/255 are replaced by 0.

    falloff: a ubs.Falloff, or a text with its expression, which replaces (1 - r)^beta. If betas is None, all betas are
    1.

    background (D,): the colour behind the splats. If it is None, the colour is 0. Returns the image (height, width, D)
    and its alpha (height, width). All tensors except depths get gradients."""
    if not isinstance(means2d, Tensor) or means2d.dtype != torch.float32 or means2d.dim() != 2:
        given = f"{means2d.dtype} {tuple(means2d.shape)}" if isinstance(means2d, Tensor) else type(means2d).__name__
        raise UsageError(f"means2d must be a float32 tensor (n, 2), not {given}")
    n = len(means2d)
    _check_tensor("means2d", means2d, (n, 2), means2d)
    _check_tensor("covs2d", covs2d, (n, 2, 2), means2d)
    _check_tensor("depths", depths, (n,), means2d)
    channels = colors.shape[1] if isinstance(colors, Tensor) and colors.dim() == 2 else 1
    _check_tensor("colors", colors, (n, channels), means2d)
    _check_tensor("opacities", opacities, (n,), means2d)
    width, height = integer(width, "width", 1), integer(height, "height", 1)
    least, most = extremes(opacities)
    if least < 0 or most > 1:
        raise UsageError(f"opacities are between {least:g} and {most:g}, but must be between 0 and 1")
    if betas is not None:
        _check_tensor("betas", betas, (n,), means2d)
        if n > 0 and extremes(betas)[0] <= 0:
            raise UsageError("betas must be positive")
    own = None if falloff is None else as_falloff(falloff)
    if own is not None and betas is None:
        betas = torch.ones_like(opacities)
    a, c = covs2d[:, 0, 0], covs2d[:, 1, 1]
    b = (covs2d[:, 0, 1] + covs2d[:, 1, 0]) / 2
    determinant = a * c - b * b
    if n > 0 and (extremes(a)[0] <= 0 or extremes(determinant)[0] <= 0):
        raise UsageError("covs2d must be positive definite: add a blur, such as 0.3 on the diagonal")
    l00 = a.sqrt()
    factor = torch.stack([l00, b / l00, (determinant / a).sqrt()])
    image, alpha = _draw_ellipses(
        (width, height), device, None, means2d, factor, depths, colors, opacities, betas, own
    )
    if background is not None:
        _check_tensor("background", background, (colors.shape[-1],), means2d)
        image = image + (1 - alpha)[..., None] * background
    return image, alpha


def _in_full(like: Tensor) -> Any:
    """Returns a context in which matrix products have the precision of their operands, also inside of torch.autocast,
    which would convert the operands to 16 bits."""
    return torch.autocast("cuda" if like.is_cuda else "cpu", enabled=False)


def _attenuation(y: Tensor, betas: Tensor | None) -> Tensor:
    """Returns prod_i (1 - tanh(y_i^2))^beta_i (docs/method.md 2.4)."""
    if betas is None:
        return y.new_ones(len(y))
    u = y * y
    logarithm = torch.where(
        u < 0.25,
        torch.log1p(-torch.tanh(u.clamp_max(0.25))),
        0.6931471805599453 - 2 * u - torch.log1p(torch.exp(-2 * u)),
    ).clamp_min(-15.942385152878742)
    return (betas * logarithm).sum(-1).exp()


def _query(means: Tensor, query: Tensor, betas: Tensor | None) -> Tensor:
    n, queries = len(means), means.shape[1] - 3
    if means.dim() != 2 or queries < 0:
        raise UsageError(f"means has the shape {tuple(means.shape)}, not (n, N) with N of at least 3")
    if betas is not None:
        _check_tensor("betas", betas, (n, queries), means)
    if tuple(query.shape) not in ((queries,), (n, queries)):
        raise UsageError(f"query has the shape {tuple(query.shape)}, not {(queries,)} or {(n, queries)}")
    return query - means[:, 3:]


def condition(
    means: Tensor,
    factor: Tensor,
    betas: Tensor | None,
    query: Tensor,
    *,
    weights: Tensor | None = None,
    cov_mode: str = "upper",
) -> tuple[Tensor, Tensor, Tensor]:
    """Slices splats of N dimensions at values of their query dimensions (docs/method.md 2.3, 2.4).

    means (n, N): the position, followed by the query dimensions. factor (n, N, N): a matrix L with independent rows;
    the covariance is L L^T. betas (n, N - 3): the exponents 4 exp(raw) of the query dimensions. If betas is None,
    opacities do not change. query: (N - 3,), or (n, N - 3) if it differs between splats, as view directions do.
    weights: the weights (n, N - 3) of the conditioning. If weights is None, they are min(betas / 4, 1), or 1 without
    betas. cov_mode: with weights, the formula of the covariance gives an asymmetric matrix. "upper" mirrors the upper
    triangle of this matrix, as published. "whiten" applies the weights so that the covariance stays symmetric and
    positive semidefinite.

    Returns positions (n, 3), covariances (n, 3, 3), and factors for the opacities (n,). Computes in the type of the
    tensors, also inside of torch.autocast, and has gradients of any order. PyTorch computes them, so backward() should
    be called outside of torch.autocast, as PyTorch recommends: inside, the gradients have only 16 bits."""
    x = _query(means, query, betas)
    n, queries = x.shape
    _check_tensor("factor", factor, (n, queries + 3, queries + 3), means)
    if cov_mode not in ("upper", "whiten"):
        raise UsageError(f"cov_mode={cov_mode!r}: choose upper or whiten")
    if weights is None:
        weights = torch.ones_like(x) if betas is None else (betas / 4).clamp_max(1)
    _check_tensor("weights", weights, (n, queries), means)
    with _in_full(means):
        spatial = factor[:, :3]
        covariance = spatial @ spatial.mT
        if queries == 0:
            return means, covariance, torch.ones_like(means[:, 0])
        # Sigma_q = lower lower^T without forming Sigma_q, which would square its condition number.
        basis, upper = torch.linalg.qr(factor[:, 3:].mT)
        signs = torch.sign(torch.diagonal(upper, dim1=-2, dim2=-1))
        basis, lower = basis * signs[:, None], (upper * signs[..., None]).mT
        across = spatial @ basis  # Sigma_xq lower^-T

        def whitened(v: Tensor) -> Tensor:
            return torch.linalg.solve_triangular(lower, v, upper=False)

        positions = means[:, :3] + (across @ whitened((weights * x)[..., None]))[..., 0]
        if cov_mode == "whiten":
            covariance = covariance - (across * weights[:, None]) @ across.mT
        else:
            sliced = covariance - across @ whitened(weights[..., None] * lower) @ across.mT
            covariance = sliced.triu() + sliced.triu(1).mT
        return positions, covariance, _attenuation(whitened(x[..., None])[..., 0], betas)


def condition_direct(
    means: Tensor,
    factor: Tensor,
    theta: Tensor,
    scales: Tensor,
    betas: Tensor | None,
    query: Tensor,
    *,
    weights: Tensor | None = None,
) -> tuple[Tensor, Tensor]:
    """Slices splats with direct conditioning (docs/method.md 9).

    means (n, N), betas, query and weights are those of condition(). factor (n, N - 3, N - 3): the lower triangular
    matrix L of the precision L L^T of the query dimensions. theta (n, 3, N - 3): the direction in which each query
    dimension moves a splat, in units of the mean scale of the splat. scales (n, 3): spatial scales. Covariances do not
    change.

    Returns positions (n, 3), and factors for the opacities (n,). Types and gradients are as with condition()."""
    x = _query(means, query, betas)
    n, queries = x.shape
    _check_tensor("factor", factor, (n, queries, queries), means)
    _check_tensor("theta", theta, (n, 3, queries), means)
    _check_tensor("scales", scales, (n, 3), means)
    if weights is None:
        weights = torch.ones_like(x) if betas is None else (betas / 4).clamp_max(1)
    _check_tensor("weights", weights, (n, queries), means)
    with _in_full(means):
        y = (factor.mT @ x[..., None])[..., 0]
        z = (factor @ y[..., None])[..., 0]
        moved = (theta @ (weights * z)[..., None])[..., 0]
    return means[:, :3] + scales.mean(-1, keepdim=True) * moved, _attenuation(y, betas)
