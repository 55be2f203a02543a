# SPDX-License-Identifier: Apache-2.0
"""The base class of all strategies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..._errors import UsageError
from .ops import Optimizers, Parameters

NEEDED = ("means", "scales", "quats", "opacities")


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
