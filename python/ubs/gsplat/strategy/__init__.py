# SPDX-License-Identifier: Apache-2.0
"""Strategies decide during training where Gaussians are added and removed. The names are those of gsplat 1.5.

The parameters are a dictionary of torch.nn.Parameter: "means" (N, 3), "scales" (N, 3) as logarithms, "quats" (N, 4),
"opacities" (N,) before the sigmoid, and further parameters (N, ...) with any names. Each trained parameter needs its
own optimiser. A strategy replaces the parameters in the dictionary and in the optimisers, and keeps the optimiser
states of the Gaussians that remain. The functions that do this are in ops.py, for strategies of your own."""

from .base import Strategy
from .default import DefaultStrategy
from .mcmc import MCMCStrategy

__all__ = ["DefaultStrategy", "MCMCStrategy", "Strategy"]
