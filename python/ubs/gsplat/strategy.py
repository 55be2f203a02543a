# SPDX-License-Identifier: Apache-2.0
"""Strategies decide during training where Gaussians are added and removed. The names are those of gsplat 1.5.

The parameters are a dictionary of torch.nn.Parameter: "means" (N, 3), "scales" (N, 3) as logarithms, "quats" (N, 4),
"opacities" (N,) before the sigmoid, and further parameters (N, ...) with any names. Each trained parameter needs its
own optimiser. A strategy replaces the parameters in the dictionary and in the optimisers, and keeps the optimiser
states of the Gaussians that remain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Dict, MutableMapping, Optional

import torch
from torch import Tensor

from .._errors import UsageError
from .rendering import _axes

Parameters = MutableMapping[str, Any]
Optimizers = Dict[str, Any]
NEEDED = ("means", "scales", "quats", "opacities")
MOST_COPIES = 51  # relocated() treats larger numbers of copies like this number


@dataclass
class Strategy:
    """Base class of all strategies. It does nothing."""

    def check_sanity(self, params: Parameters, optimizers: Optimizers) -> None:
        """Raises UsageError if one of the parameters NEEDED is missing, or if the optimisers do not match the trained
        parameters: there must be one optimiser with one parameter for each of them."""
        missing = [name for name in NEEDED if name not in params]
        if missing:
            raise UsageError(f"params has no {', '.join(missing)}: a strategy needs {', '.join(NEEDED)}")
        learnt = {name for name, value in params.items() if value.requires_grad}
        if learnt != set(optimizers):
            different = ", ".join(sorted(learnt ^ set(optimizers)))
            raise UsageError(
                f"parameters with requires_grad and optimisers must have the same names: check {different}"
            )
        for name, optimizer in optimizers.items():
            groups = optimizer.param_groups
            if len(groups) != 1 or len(groups[0]["params"]) != 1 or groups[0]["params"][0] is not params[name]:
                raise UsageError(f"the optimiser {name!r} must have one group with one parameter, params[{name!r}]")

    def step_pre_backward(self, *args: Any, **kwargs: Any) -> None:
        """Must be called between rasterization() and backward()."""

    def step_post_backward(self, *args: Any, **kwargs: Any) -> None:
        """Must be called after backward()."""


def _replace(
    params: Parameters, optimizers: Optimizers, state: Dict[str, Any], kept: Tensor, copied: Tensor,
    changed: Dict[str, Tensor],
) -> None:
    """Keeps the Gaussians with the indices `kept`, and appends copies of the Gaussians with the indices `copied`. For
    the parameters in `changed`, the copies get the values in `changed`. The optimiser states of the copies are 0. The
    tensors in `state` are kept and copied in the same way."""
    with torch.no_grad():
        for name in list(params):
            old = params[name]
            extra = changed[name].to(old) if name in changed else old[copied]
            new = torch.nn.Parameter(torch.cat([old[kept], extra]), requires_grad=old.requires_grad)
            params[name] = new
            if name not in optimizers:
                continue
            optimizer = optimizers[name]
            noted = optimizer.state.pop(old, None)
            optimizer.param_groups[0]["params"] = [new]
            if noted is not None:
                for key, value in noted.items():
                    if isinstance(value, Tensor) and value.shape == old.shape:
                        noted[key] = torch.cat([value[kept], torch.zeros_like(extra)])
                optimizer.state[new] = noted
        for key, value in state.items():
            if isinstance(value, Tensor):
                state[key] = torch.cat([value[kept], value[copied]])


def _forget(params: Parameters, optimizers: Optimizers, names: list[str], indices: Optional[Tensor] = None) -> None:
    """Sets the optimiser states of these Gaussians to 0."""
    for name in names:
        if name in optimizers:
            for value in optimizers[name].state.get(params[name], {}).values():
                if isinstance(value, Tensor) and value.shape == params[name].shape:
                    value[slice(None) if indices is None else indices] = 0


def _all(params: Parameters) -> Tensor:
    means = params["means"]
    return torch.arange(len(means), device=means.device)


def _rotated(params: Parameters, indices: Tensor, vectors: Tensor, times: int) -> Tensor:
    """Returns A v for times = 1, and A A^T v for times = 2. v are the vectors (n, 3), one for each of the Gaussians
    `indices`, and A is the rotation matrix of the Gaussian times its scales."""
    axes = _axes(params["quats"][indices][None], torch.exp(params["scales"][indices])[None])[:, :, 0]
    if times == 2:
        vectors = (axes * vectors.T[:, None]).sum(0).T
    return (axes * vectors.T).sum(1).T  # not a matrix product, which would lose precision in torch.autocast


@dataclass
class DefaultStrategy(Strategy):
    """The strategy published with 3D Gaussian Splatting (Kerbl et al. 2023). Gaussians whose centre in the image has a
    large gradient are copied if they are small, and split into two if they are large. Nearly transparent Gaussians are
    removed."""

    prune_opa: float = 0.005
    """Gaussians with a lower opacity are removed."""
    grow_grad2d: float = 0.0002
    """A Gaussian is copied or split if the mean length of the gradient of its centre in the image is above this value.
    The unit of the centre is half the image size."""
    grow_scale3d: float = 0.01
    """A Gaussian is copied if the largest of its scales, divided by scene_scale, is at most this value. Larger
    Gaussians are split."""
    grow_scale2d: float = 0.05
    """A Gaussian is split if its radius in the image, divided by the larger side of the image, is above this value.
    This applies before the step refine_scale2d_stop_iter."""
    prune_scale3d: float = 0.1
    """A Gaussian is removed if the largest of its scales, divided by scene_scale, is above this value. This applies
    after the first reset of opacities."""
    prune_scale2d: float = 0.15
    """A Gaussian is removed if its radius in the image, divided by the larger side of the image, is above this value.
    This applies after the first reset of opacities, and before the step refine_scale2d_stop_iter."""
    refine_scale2d_stop_iter: int = 0
    """Radii in the image are considered before this step. With 0, they are never considered."""
    refine_start_iter: int = 500
    refine_stop_iter: int = 15_000
    reset_every: int = 3000
    """Number of steps between two resets of the opacities. A reset limits all opacities to twice prune_opa."""
    refine_every: int = 100
    pause_refine_after_reset: int = 0
    """Number of steps without refinement after each reset."""
    absgrad: bool = False
    """Whether to use the sums of absolute gradients. These are larger, so grow_grad2d should be higher, such as 0.0008.
    Requires rasterization(..., absgrad=True)."""
    revised_opacity: bool = False
    """Whether the two parts of a split Gaussian get lower opacities, so that both parts together are as opaque as the
    original Gaussian (Rota Bulo et al. 2024)."""
    verbose: bool = False
    key_for_gradient: str = "means2d"

    def initialize_state(self, scene_scale: float = 1.0) -> Dict[str, Any]:
        """Returns the state for step_pre_backward() and step_post_backward()."""
        state: Dict[str, Any] = {"grad2d": None, "count": None, "scene_scale": scene_scale}
        return {**state, "radii": None} if self.refine_scale2d_stop_iter > 0 else state

    def step_pre_backward(
        self, params: Parameters, optimizers: Optimizers, state: Dict[str, Any], step: int, info: Dict[str, Any]
    ) -> None:
        """Must be called between rasterization() and backward()."""
        info[self.key_for_gradient].retain_grad()

    def step_post_backward(
        self,
        params: Parameters,
        optimizers: Optimizers,
        state: Dict[str, Any],
        step: int,
        info: Dict[str, Any],
        packed: bool = False,
    ) -> None:
        """Must be called after backward(). `packed`: the value that was passed to rasterization()."""
        if step >= self.refine_stop_iter:
            return
        with torch.no_grad():
            self._gather(params, state, info, packed)
            if (
                step > self.refine_start_iter
                and step % self.refine_every == 0
                and step % self.reset_every >= self.pause_refine_after_reset
            ):
                copied, split = self._grow(params, optimizers, state, step)
                removed = self._prune(params, optimizers, state, step)
                if self.verbose:
                    now = len(params["means"])
                    print(f"step {step}: {copied} Gaussians copied, {split} split, {removed} removed, now {now}")
                for key in ("grad2d", "count", "radii"):
                    if state.get(key) is not None:
                        state[key].zero_()
            if step > 0 and step % self.reset_every == 0:
                most = torch.logit(torch.tensor(2 * self.prune_opa)).item()
                params["opacities"].clamp_(max=most)
                _forget(params, optimizers, ["opacities"])

    def _gather(self, params: Parameters, state: Dict[str, Any], info: Dict[str, Any], packed: bool) -> None:
        """Accumulates gradients, counts and maximum radii of visible Gaussians."""
        if packed != (info["gaussian_ids"] is not None):
            raise UsageError(
                f"packed={packed}, but rasterization() was called with packed={not packed}: pass the same value"
            )
        centre = info[self.key_for_gradient]
        gradient = getattr(centre, "absgrad", None) if self.absgrad else centre.grad
        if gradient is None:
            needed = "rasterization(..., absgrad=True)" if self.absgrad else "step_pre_backward() before backward()"
            raise UsageError(f"{self.key_for_gradient} has no gradient: call {needed}")
        half = gradient.new_tensor([info["width"] / 2, info["height"] / 2]) * info["n_cameras"]
        length = (gradient * half).norm(dim=-1)
        radii = info["radii"]
        if packed:
            ids = info["gaussian_ids"]
        else:
            seen = (radii > 0).all(-1)
            ids, length, radii = torch.where(seen)[-1], length[seen], radii[seen]
        count = len(params["means"])
        for key in ("grad2d", "count", "radii"):
            if key in state and state[key] is None:
                state[key] = torch.zeros(count, device=length.device)
        state["grad2d"].index_add_(0, ids, length)
        state["count"].index_add_(0, ids, torch.ones_like(length))
        if "radii" in state:
            largest = radii.amax(-1).float() / float(max(info["width"], info["height"]))
            state["radii"].scatter_reduce_(0, ids, largest, "amax")

    def _grow(self, params: Parameters, optimizers: Optimizers, state: Dict[str, Any], step: int) -> tuple[int, int]:
        moved = state["grad2d"] / state["count"].clamp_min(1) > self.grow_grad2d
        small = torch.exp(params["scales"]).amax(-1) <= self.grow_scale3d * state["scene_scale"]
        divided = moved & ~small
        if step < self.refine_scale2d_stop_iter:
            divided |= state["radii"] > self.grow_scale2d
        copied = torch.where(moved & small)[0]
        _replace(params, optimizers, state, _all(params), copied, {})
        divided = torch.cat([divided, divided.new_zeros(len(copied))])
        chosen = torch.where(divided)[0].repeat(2)
        changed = {
            "means": params["means"][chosen]
            + _rotated(params, chosen, torch.randn(len(chosen), 3, device=chosen.device), 1),
            "scales": params["scales"][chosen] - torch.log(torch.tensor(1.6)),
        }
        if self.revised_opacity:
            changed["opacities"] = torch.logit(1 - (1 - torch.sigmoid(params["opacities"][chosen])).sqrt())
        _replace(params, optimizers, state, torch.where(~divided)[0], chosen, changed)
        return len(copied), len(chosen) // 2

    def _prune(self, params: Parameters, optimizers: Optimizers, state: Dict[str, Any], step: int) -> int:
        gone = torch.sigmoid(params["opacities"].flatten()) < self.prune_opa
        if step > self.reset_every:
            gone |= torch.exp(params["scales"]).amax(-1) > self.prune_scale3d * state["scene_scale"]
            if step < self.refine_scale2d_stop_iter:
                gone |= state["radii"] > self.prune_scale2d
        _replace(params, optimizers, state, torch.where(~gone)[0], torch.where(gone)[0][:0], {})
        return int(gone.sum())


def relocated(opacities: Tensor, scales: Tensor, copies: Tensor) -> tuple[Tensor, Tensor]:
    """Computes new opacities (n,) and scales (n, 3) for Gaussians that are replaced by several copies at the same
    position. `copies` (n,) is the number of Gaussians that replace each Gaussian. With the new values, these Gaussians
    together look like the original Gaussian (Kheradmand et al. 2024, equation 9)."""
    number = copies.clamp(1, MOST_COPIES).double()
    before = opacities.double()
    after = 1 - (1 - before) ** (1 / number)
    total = torch.zeros_like(after)
    chosen = torch.ones_like(after)  # the binomial coefficient "number choose k", the inner sum of the equation
    for k in range(1, MOST_COPIES + 1):
        chosen = chosen * (number - (k - 1)) / k
        total = total - (-1.0) ** k * chosen * after**k / k**0.5
    return after.to(opacities), scales * (before / total).to(scales)[:, None]


@dataclass
class MCMCStrategy(Strategy):
    """The strategy of "3D Gaussian Splatting as Markov Chain Monte Carlo" (Kheradmand et al. 2024). Nearly transparent
    Gaussians are moved to the positions of other Gaussians. These are chosen at random, with probabilities that are
    proportional to their opacities. New Gaussians are added at positions that are chosen in the same way. Noise is
    added to the positions of Gaussians with a low opacity."""

    cap_max: int = 1_000_000
    """Maximum number of Gaussians."""
    noise_lr: float = 5e5
    """Strength of the noise, multiplied by the learning rate of the means."""
    refine_start_iter: int = 500
    refine_stop_iter: int = 25_000
    noise_injection_stop_iter: int = -1
    """First step without noise. With -1, noise is added in all steps."""
    refine_every: int = 100
    min_opacity: float = 0.005
    """Gaussians with at most this opacity are moved to the positions of others."""
    verbose: bool = False
    noise_opacity_t: float = 0.005
    """Opacity for which the noise has half of its strength."""
    noise_opacity_k: float = 100.0
    """How fast the noise decreases with the opacity. The noise of a Gaussian is multiplied by
    sigmoid(noise_opacity_k * (noise_opacity_t - opacity))."""

    def initialize_state(self) -> Dict[str, Any]:
        """Returns the state for step_post_backward(), which is empty here."""
        return {}

    def step_post_backward(
        self,
        params: Parameters,
        optimizers: Optimizers,
        state: Dict[str, Any],
        step: int,
        info: Dict[str, Any],
        lr: float,
    ) -> None:
        """Must be called after backward() and the steps of the optimisers. lr: learning rate of the means."""
        with torch.no_grad():
            if self.refine_start_iter < step < self.refine_stop_iter and step % self.refine_every == 0:
                dead = torch.sigmoid(params["opacities"].flatten()) <= self.min_opacity
                moved = self._move(params, optimizers, torch.where(dead)[0], torch.where(~dead)[0])
                count = len(params["means"])
                added = max(0, min(self.cap_max, int(1.05 * count)) - count)
                if added:
                    chosen = self._share(params, optimizers, _all(params), added)
                    _replace(params, optimizers, {}, _all(params), chosen, {})
                if self.verbose:
                    print(f"step {step}: {moved} Gaussians moved, {added} added, now {len(params['means'])}")
            if 0 <= self.noise_injection_stop_iter <= step:
                return
            opacities = torch.sigmoid(params["opacities"].flatten())
            loose = torch.sigmoid(self.noise_opacity_k * (self.noise_opacity_t - opacities)) * (lr * self.noise_lr)
            noise = torch.randn_like(params["means"]) * loose[:, None]
            params["means"].add_(_rotated(params, _all(params), noise, 2))

    def _move(self, params: Parameters, optimizers: Optimizers, dead: Tensor, alive: Tensor) -> int:
        if len(dead) == 0 or len(alive) == 0:
            return 0
        chosen = self._share(params, optimizers, alive, len(dead))
        for value in params.values():
            value[dead] = value[chosen]
        _forget(params, optimizers, list(params), dead)
        return len(dead)

    def _share(self, params: Parameters, optimizers: Optimizers, among: Tensor, number: int) -> Tensor:
        """Chooses `number` of the Gaussians `among` at random, with probabilities proportional to their opacities, and
        returns their indices. The caller copies the chosen Gaussians. This function changes their opacities and scales,
        so that each of them and its copies together look like the Gaussian before."""
        opacities = torch.sigmoid(params["opacities"])
        sums = opacities.flatten()[among].double().cumsum(0)
        at = torch.rand(number, dtype=torch.float64, device=sums.device) * sums[-1]
        chosen = among[torch.searchsorted(sums, at).clamp_max(len(among) - 1)]
        copies = torch.bincount(chosen, minlength=len(opacities))
        several = torch.where(copies > 0)[0]
        opacity, scales = relocated(
            opacities.flatten()[several], torch.exp(params["scales"][several]), copies[several] + 1
        )
        opacity = opacity.clamp(self.min_opacity, 1 - torch.finfo(torch.float32).eps)
        params["opacities"][several] = torch.logit(opacity).reshape(-1, *opacities.shape[1:])
        params["scales"][several] = torch.log(scales)
        _forget(params, optimizers, list(params), several)
        return chosen
