# SPDX-License-Identifier: Apache-2.0
"""The strategy of "3D Gaussian Splatting as Markov Chain Monte Carlo"."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Dict

import numpy as np
import torch
from torch import Tensor

from ..._errors import UsageError
from ..._settings import BOOLEANS
from .base import Strategy
from .ops import Optimizers, Parameters, inject_noise_to_position, relocate, sample_add

MOST_COPIES = 51  # compute_relocation() treats larger numbers of copies like this number
BINOMS = torch.tensor([[math.comb(n, k) for k in range(MOST_COPIES)] for n in range(MOST_COPIES)], dtype=torch.float32)


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

    def __post_init__(self) -> None:
        whole = isinstance(self.refine_every, (int, np.integer)) and not isinstance(self.refine_every, BOOLEANS)
        if not whole or self.refine_every < 1:
            raise UsageError(
                f"refine_every={self.refine_every} must be a whole number of at least 1; if you pass arguments by "
                f"position, use the order of gsplat 1.6: noise_injection_stop_iter comes before refine_every"
            )

    def initialize_state(self) -> Dict[str, Any]:
        """Returns the state for step_post_backward(). It contains the table `binoms` for the functions in ops.py."""
        return {"binoms": BINOMS.clone()}

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
        if self.refine_start_iter < step < self.refine_stop_iter and step % self.refine_every == 0:
            moved = self._relocate_gs(params, optimizers, BINOMS)
            added = self._add_new_gs(params, optimizers, BINOMS)
            if self.verbose:
                print(f"step {step}: {moved} Gaussians moved, {added} added, now {len(params['means'])}")
        if not 0 <= self.noise_injection_stop_iter <= step:
            inject_noise_to_position(
                params, optimizers, {}, lr * self.noise_lr, t=self.noise_opacity_t, k=self.noise_opacity_k
            )

    def _relocate_gs(self, params: Parameters, optimizers: Optimizers, binoms: Tensor) -> int:
        """Moves nearly transparent Gaussians, and returns their number."""
        with torch.no_grad():
            dead = torch.sigmoid(params["opacities"].flatten()) <= self.min_opacity
        if bool(dead.all()):
            return 0
        relocate(params, optimizers, {}, dead, binoms, self.min_opacity)
        return int(dead.sum())

    def _add_new_gs(self, params: Parameters, optimizers: Optimizers, binoms: Tensor) -> int:
        """Adds 5 % more Gaussians, but at most cap_max in total. Returns the number of new Gaussians."""
        count = len(params["means"])
        added = max(0, min(self.cap_max, int(1.05 * count)) - count)
        if added:
            sample_add(params, optimizers, {}, added, binoms, self.min_opacity)
        return added
