# SPDX-License-Identifier: Apache-2.0
"""An optimiser that only changes visible Gaussians."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from .._errors import UsageError


class SelectiveAdam(torch.optim.Adam):
    """Adam for which the caller chooses the rows that a step changes. The other rows of the parameters and moments stay
    as they are, which saves time if few Gaussians are visible (Taming 3DGS, Mallick et al. 2024).

    As in gsplat, the moments are not divided by 1 - beta^step. So the first steps are larger than those of Adam: with
    the betas (0.9, 0.999), the first one is 3.2 times as large. Each group must have exactly one parameter. `eps` and
    `betas` are those of Adam."""

    def __init__(self, params: Any, eps: float, betas: tuple[float, float]) -> None:
        super().__init__(params, eps=eps, betas=betas)

    def step(self, visibility: Tensor) -> None:
        """Changes the rows of each parameter (N, ...) for which `visibility` (N,) is not 0."""
        with torch.no_grad():
            rows = torch.where(visibility)[0]
            for group in self.param_groups:
                if len(group["params"]) != 1:
                    raise UsageError(f"a group has {len(group['params'])} parameters: pass one group per parameter")
                param = group["params"][0]
                if param.grad is None:
                    continue
                if param.grad.is_sparse:
                    raise UsageError("SelectiveAdam does not support sparse gradients: do not set sparse_grad")
                if len(visibility) != len(param):
                    raise UsageError(f"visibility has {len(visibility)} values, but a parameter has {len(param)} rows")
                state = self.state[param]
                if not state:
                    state.update(step=torch.tensor(0.0), exp_avg=torch.zeros_like(param))
                    state.update(exp_avg_sq=torch.zeros_like(param))
                (b1, b2), gradient = group["betas"], param.grad[rows]
                first = b1 * state["exp_avg"][rows] + (1 - b1) * gradient
                second = b2 * state["exp_avg_sq"][rows] + (1 - b2) * gradient * gradient
                state["exp_avg"][rows], state["exp_avg_sq"][rows] = first, second
                param[rows] -= group["lr"] * first / (second.sqrt() + group["eps"])
