# SPDX-License-Identifier: Apache-2.0
"""Functions that add, remove and change Gaussians. The strategies call them, and so can strategies of your own.

All functions change `params`, `optimizers` and `state`. `params` and `optimizers` are described in __init__.py. `state`
is a dictionary that may contain tensors with one row per Gaussian. A mask (N,) is a tensor of bool that selects
Gaussians. The table `binoms` is described in compute_relocation()."""

from __future__ import annotations

import math
from typing import Any, Callable, Dict, List, MutableMapping, Optional

import torch
from torch import Tensor

from ..._errors import UsageError
from ..relocation import compute_relocation
from ..rendering import _axes

Parameters = MutableMapping[str, Any]
Optimizers = Dict[str, Any]


def _update_param_with_optimizer(
    param_fn: Callable[[str, Tensor], Tensor],
    optimizer_fn: Callable[[str, Tensor], Tensor],
    params: Parameters,
    optimizers: Optimizers,
    names: Optional[List[str]] = None,
) -> None:
    """Replaces each parameter by param_fn(name, parameter), in the dictionary and in its optimiser. Replaces those
    tensors in the state of the optimiser that have the shape of the parameter by optimizer_fn(key, tensor). `names` are
    the names of the parameters; None means all."""
    with torch.no_grad():
        for name in list(params) if names is None else names:
            old = params[name]
            params[name] = new = param_fn(name, old)
            if name not in optimizers:
                continue
            optimizer = optimizers[name]
            noted = optimizer.state.pop(old, None)
            optimizer.param_groups[0]["params"] = [new]
            if noted is not None:
                for key, value in noted.items():
                    if isinstance(value, Tensor) and value.shape == old.shape:
                        noted[key] = optimizer_fn(key, value)
                optimizer.state[new] = noted


def _replace(
    params: Parameters, optimizers: Optimizers, state: Dict[str, Any], kept: Tensor, copied: Tensor,
    changed: Dict[str, Tensor],
) -> None:
    """Keeps the Gaussians with the indices `kept`, and appends copies of the Gaussians with the indices `copied`. For
    the parameters in `changed`, the copies get the values in `changed`. The optimiser states of the copies are 0. The
    tensors in `state` are kept and copied in the same way."""

    def values(name: str, old: Tensor) -> Tensor:
        extra = changed[name].to(old) if name in changed else old[copied]
        new: Tensor = torch.nn.Parameter(torch.cat([old[kept], extra]), requires_grad=old.requires_grad)
        return new

    def moments(_: str, old: Tensor) -> Tensor:
        return torch.cat([old[kept], old.new_zeros(len(copied), *old.shape[1:])])

    _update_param_with_optimizer(values, moments, params, optimizers)
    for key, value in state.items():
        if isinstance(value, Tensor):
            state[key] = torch.cat([value[kept], value[copied]])


def _forget(params: Parameters, optimizers: Optimizers, names: List[str], indices: Any) -> None:
    """Sets the optimiser states of these Gaussians to 0. Discards the gradients of the parameters, which belong to the
    values before they were changed."""

    def zeroed(_: str, value: Tensor) -> Tensor:
        value[indices] = 0
        return value

    _update_param_with_optimizer(lambda _, value: value, zeroed, params, optimizers, names)
    for name in names:
        params[name].grad = None


def _all(params: Parameters) -> Tensor:
    means = params["means"]
    return torch.arange(len(means), device=means.device)


def _rotated(params: Parameters, indices: Tensor, vectors: Tensor, times: int) -> Tensor:
    """Returns A v for times = 1, and A A^T v for times = 2. v are the vectors (n, 3), one for each of the Gaussians
    `indices`. The columns of A are the half-axes of the Gaussian: those of its rotation matrix times its scales."""
    axes = _axes(params["quats"][indices][None], torch.exp(params["scales"][indices])[None])[:, :, 0]
    if times == 2:
        vectors = (axes * vectors.T[:, None]).sum(0).T
    return (axes * vectors.T).sum(1).T  # not a matrix product, which would lose precision in torch.autocast


def _refuse_scene(scene: Any) -> None:
    """`scene` is an argument of gsplat 1.6."""
    if scene is not None:
        raise UsageError("scene is not supported by ubs.gsplat: remove it, and pass the parameters instead")


def duplicate(
    params: Parameters, optimizers: Optimizers, state: Dict[str, Any], mask: Tensor, scene: None = None
) -> None:
    """Appends copies of the Gaussians in `mask`."""
    _refuse_scene(scene)
    if not bool(mask.any()):
        return
    _replace(params, optimizers, state, _all(params), torch.where(mask)[0], {})


def split(
    params: Parameters, optimizers: Optimizers, state: Dict[str, Any], mask: Tensor, revised_opacity: bool = False,
    scene: None = None,
) -> None:
    """Replaces each Gaussian in `mask` by two that are smaller by a factor of 1.6. Their positions are random samples
    of the Gaussian. All first parts are appended, then all second parts. With `revised_opacity`, both parts get lower
    opacities, so that together they are as opaque as the original Gaussian."""
    _refuse_scene(scene)
    if not bool(mask.any()):
        return
    chosen = torch.where(mask)[0].repeat(2)
    with torch.no_grad():
        noise = torch.randn(len(chosen), 3, device=chosen.device)
        changed = {
            "means": params["means"][chosen] + _rotated(params, chosen, noise, 1),
            "scales": params["scales"][chosen] - torch.log(torch.tensor(1.6)),
        }
        if revised_opacity:
            changed["opacities"] = torch.logit(1 - (1 - torch.sigmoid(params["opacities"][chosen])).sqrt())
    _replace(params, optimizers, state, torch.where(~mask)[0], chosen, changed)


def remove(
    params: Parameters, optimizers: Optimizers, state: Dict[str, Any], mask: Tensor, scene: None = None
) -> None:
    """Removes the Gaussians in `mask`."""
    _refuse_scene(scene)
    if not bool(mask.any()):
        return
    _replace(params, optimizers, state, torch.where(~mask)[0], torch.where(mask)[0][:0], {})


def reset_opa(params: Parameters, optimizers: Optimizers, state: Dict[str, Any], value: float) -> None:
    """Limits all opacities to `value`, which is above 0 and below 1, and sets their optimiser states to 0."""
    with torch.no_grad():
        params["opacities"].clamp_(max=math.log(value / (1 - value)))
    _forget(params, optimizers, ["opacities"], slice(None))


def _share(
    params: Parameters, optimizers: Optimizers, among: Tensor, number: int, binoms: Tensor, min_opacity: float
) -> Tensor:
    """Chooses `number` of the Gaussians `among` at random, with probabilities proportional to their opacities, and
    returns their indices. The caller copies the chosen Gaussians. This function changes their opacities and scales, so
    that each of them and its copies together look like the Gaussian before. It sets their optimiser states to 0."""
    opacities = torch.sigmoid(params["opacities"])
    sums = opacities.flatten()[among].double().cumsum(0)
    at = torch.rand(number, dtype=torch.float64, device=sums.device) * sums[-1]
    chosen = among[torch.searchsorted(sums, at).clamp_max(len(among) - 1)]
    copies = torch.bincount(chosen, minlength=len(opacities))
    several = torch.where(copies > 0)[0]
    opacity, scales = compute_relocation(
        opacities[several], torch.exp(params["scales"][several]), copies[several] + 1, binoms, min_opacity
    )
    opacity = opacity.clamp(min_opacity, 1 - torch.finfo(torch.float32).eps)
    params["opacities"][several] = torch.logit(opacity)
    params["scales"][several] = torch.log(scales)
    _forget(params, optimizers, list(params), several)
    return chosen


def relocate(
    params: Parameters, optimizers: Optimizers, state: Dict[str, Any], mask: Tensor, binoms: Tensor,
    min_opacity: float = 0.005, scene: None = None,
) -> None:
    """Moves the Gaussians in `mask` to the positions of others, as copies of these. The others are chosen at random,
    with probabilities that are proportional to their opacities. The chosen Gaussians and their copies get lower
    opacities, of at least `min_opacity`, and smaller scales, so that together they look like the chosen Gaussian did
    before. The optimiser states of all these Gaussians become 0, and so do the rows of the chosen Gaussians in `state`.
    Does nothing if all Gaussians are in `mask`."""
    _refuse_scene(scene)
    gone, others = torch.where(mask)[0], torch.where(~mask)[0]
    if len(gone) == 0 or len(others) == 0:
        return
    with torch.no_grad():
        chosen = _share(params, optimizers, others, len(gone), binoms, min_opacity)
        for value in params.values():
            value[gone] = value[chosen]
    _forget(params, optimizers, list(params), gone)
    for value in state.values():
        if isinstance(value, Tensor):
            value[chosen] = 0


def sample_add(
    params: Parameters, optimizers: Optimizers, state: Dict[str, Any], n: int, binoms: Tensor,
    min_opacity: float = 0.005, scene: None = None,
) -> None:
    """Appends `n` copies of Gaussians, which are chosen and changed as in relocate(). The new rows of the tensors in
    `state` are 0."""
    _refuse_scene(scene)
    with torch.no_grad():
        chosen = _share(params, optimizers, _all(params), n, binoms, min_opacity)
    _replace(params, optimizers, {}, _all(params), chosen, {})
    for key, value in state.items():
        if isinstance(value, Tensor):
            state[key] = torch.cat([value, value.new_zeros(n, *value.shape[1:])])


def inject_noise_to_position(
    params: Parameters, optimizers: Optimizers, state: Dict[str, Any], noise_scale: Optional[float] = None, *,
    scaler: Optional[float] = None, t: float = 0.005, k: float = 100.0,
) -> None:
    """Adds normally distributed noise to the positions. Its covariance matrix is the square of the covariance matrix of
    the Gaussian, times the square of the factor noise_scale * sigmoid(k * (t - opacity)). `scaler` is the name that
    noise_scale has in gsplat 1.5."""
    if (noise_scale is None) == (scaler is None):
        raise UsageError("pass noise_scale, or scaler, which is its earlier name")
    factor = scaler if noise_scale is None else noise_scale
    with torch.no_grad():
        loose = torch.sigmoid(k * (t - torch.sigmoid(params["opacities"].flatten()))) * factor
        noise = torch.randn_like(params["means"]) * loose[:, None]
        params["means"].add_(_rotated(params, _all(params), noise, 2))
