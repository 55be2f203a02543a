# SPDX-License-Identifier: Apache-2.0
"""The opacities and scales of Gaussians that are replaced by several copies (Kheradmand et al. 2024, equation 9)."""

from __future__ import annotations

import torch
from torch import Tensor

from .._errors import UsageError


def compute_relocation(
    opacities: Tensor, scales: Tensor, ratios: Tensor, binoms: Tensor, min_opacity: float = 0.0
) -> tuple[Tensor, Tensor]:
    """Computes new opacities and scales (N, 3) for Gaussians that are replaced by several copies at the same position.
    With the new values, these copies together look like the original Gaussian.

    opacities (N,) or (N, 1) are from 0 to 1, and scales (N, 3) are not logarithms. `ratios` (N,) is the number of
    Gaussians that replace each Gaussian, from 1 to n_max; other numbers are clamped to this range. n_max is the size of
    `binoms` (n_max, n_max), which is a table of binomial coefficients in gsplat. Only its size is used here.

    The new opacities are at least `min_opacity`, and below 1; the scales are computed from these values. The default of
    gsplat 1.6 is 0.005. With the default 0, results are those of gsplat 1.5, which has no such argument."""
    count, most = len(opacities), len(binoms)
    if tuple(scales.shape) != (count, 3) or tuple(ratios.shape) != (count,) or opacities.numel() != count:
        shapes = ", ".join(str(tuple(tensor.shape)) for tensor in (opacities, scales, ratios))
        raise UsageError(f"opacities, scales and ratios have the shapes {shapes}, not (N,), (N, 3), (N,)")
    number = ratios.clamp(1, most).double()
    before = opacities.flatten().double()
    after = 1 - (1 - before) ** (1 / number)
    if min_opacity > 0:
        after = after.clamp(min_opacity, 1 - torch.finfo(torch.float32).eps)
    total = torch.zeros_like(after)
    chosen = torch.ones_like(after)  # the binomial coefficient "number choose k", the inner sum of the equation
    for k in range(1, most + 1):
        chosen = chosen * (number - (k - 1)) / k
        total = total - (-1.0) ** k * chosen * after**k / k**0.5
    factor = torch.where(total > 0, before / total, torch.ones_like(total))  # the limit for the opacity 0 is 1
    return after.to(opacities).reshape(opacities.shape), scales * factor.to(scales)[:, None]
