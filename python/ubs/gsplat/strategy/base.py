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
    """A strategy that changes nothing. Strategies of your own inherit from it."""

    def check_sanity(self, params: Parameters, optimizers: Optimizers) -> None:
        """Raises UsageError if one of the parameters NEEDED is missing. Also raises it unless each trained parameter
        has an optimiser with the same name, and this optimiser has no other parameters."""
        missing = [name for name in NEEDED if name not in params]
        if missing:
            raise UsageError(f"params has no {', '.join(missing)}: a strategy needs {', '.join(NEEDED)}")
        learnt = {name for name, value in params.items() if value.requires_grad}
        if learnt != set(optimizers):
            different = ", ".join(sorted(learnt ^ set(optimizers)))
            raise UsageError(f"each trained parameter needs an optimiser with its name, and no others: see {different}")
        for name, optimizer in optimizers.items():
            groups = optimizer.param_groups
            if len(groups) != 1 or len(groups[0]["params"]) != 1 or groups[0]["params"][0] is not params[name]:
                raise UsageError(f"the optimiser {name!r} must have one group with one parameter, params[{name!r}]")

    def step_pre_backward(self, *args: Any, **kwargs: Any) -> None:
        """Must be called between rasterization() and backward()."""

    def step_post_backward(self, *args: Any, **kwargs: Any) -> None:
        """Must be called after backward()."""
