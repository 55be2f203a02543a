# SPDX-License-Identifier: Apache-2.0
"""The strategy published with 3D Gaussian Splatting."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Dict

import torch
from torch import Tensor

from ..._errors import UsageError
from .base import Strategy
from .ops import Optimizers, Parameters, duplicate, remove, reset_opa, split


def _maxima(ids: Tensor, values: Tensor) -> tuple[Tensor, Tensor]:
    """Returns the different ids, and the maximum of the values of each id. PyTorch warns that scatter_reduce_() and
    index_reduce_() may change."""
    order = values.argsort()
    ids, again = ids[order].sort(stable=True)
    last = torch.ones_like(ids, dtype=torch.bool)
    last[:-1] = ids[1:] != ids[:-1]
    return ids[last], values[order][again][last]


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
    """Whether means2d.absgrad is used in place of the gradient. rasterization() must then compute it (absgrad=True).
    Its values are several times as large, so grow_grad2d should be larger, too; 0.0008 is usual."""
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
            self._update_state(params, state, info, packed)
            since_reset = step % self.reset_every
            is_due = step > self.refine_start_iter and step % self.refine_every == 0
            if is_due and since_reset >= self.pause_refine_after_reset:
                copied, divided = self._grow_gs(params, optimizers, state, step)
                removed = self._prune_gs(params, optimizers, state, step)
                if self.verbose:
                    now = len(params["means"])
                    print(f"step {step}: {copied} Gaussians copied, {divided} split, {removed} removed, now {now}")
                for key in ("grad2d", "count", "radii"):
                    if state.get(key) is not None:
                        state[key].zero_()
            if step > 0 and since_reset == 0:
                reset_opa(params, optimizers, state, 2 * self.prune_opa)

    def _update_state(
        self, params: Parameters, state: Dict[str, Any], info: Dict[str, Any], packed: bool = False
    ) -> None:
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
            side = max(info["width"], info["height"])
            ids, largest = _maxima(ids, radii.amax(-1) / side)
            state["radii"][ids] = torch.maximum(state["radii"][ids], largest)

    def _grow_gs(
        self, params: Parameters, optimizers: Optimizers, state: Dict[str, Any], step: int
    ) -> tuple[int, int]:
        """Copies and splits Gaussians. Returns the number of copied and the number of split Gaussians."""
        moved = state["grad2d"] / state["count"].clamp_min(1) > self.grow_grad2d
        small = torch.exp(params["scales"]).amax(-1) <= self.grow_scale3d * state["scene_scale"]
        copied, divided = moved & small, moved & ~small
        if step < self.refine_scale2d_stop_iter:
            divided |= state["radii"] > self.grow_scale2d
        duplicate(params, optimizers, state, copied)
        number = int(copied.sum())
        split(params, optimizers, state, torch.cat([divided, divided.new_zeros(number)]), self.revised_opacity)
        return number, int(divided.sum())

    def _prune_gs(self, params: Parameters, optimizers: Optimizers, state: Dict[str, Any], step: int) -> int:
        """Removes Gaussians, and returns their number."""
        gone = torch.sigmoid(params["opacities"].flatten()) < self.prune_opa
        if step > self.reset_every:
            gone |= torch.exp(params["scales"]).amax(-1) > self.prune_scale3d * state["scene_scale"]
            if step < self.refine_scale2d_stop_iter:
                gone |= state["radii"] > self.prune_scale2d
        remove(params, optimizers, state, gone)
        return int(gone.sum())
