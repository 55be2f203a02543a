// SPDX-License-Identifier: Apache-2.0
// Where a splat's alpha o (1 - r)^beta falls to the least that counts (UBS_LEAST_ALPHA): the part of the support that
// has an effect. Never too small: alphas that rounding lifts above the limit lie inside as well.
#pragma once

// opacity > 0. Beta: r = 1 - (limit / o)^(1 / beta); Gaussian: r = 2 ln(o / limit). At most the support; not above 0
// where the splat has no effect anywhere. With UBS_OPACITY_EXTENTS only.
UBS_FN vreal splat_reach(vreal opacity, vreal beta) {
  // The rasteriser computes alpha to 1.1e-5 relative or better (exponent of at most 20 times ln 2 times 7.5e-7,
  // kernels/math/elementary.h), so that no alpha counts where the exact one is below the limit by more than 2e-5.
  real least = (UBS_OPACITY_EXTENTS ? UBS_LEAST_ALPHA : R(1.0)) * (R(1.0) - R(2e-5));
  real margin = R(4e-6);  // rounding of what follows: 4e-7; Gaussian, where r goes up to 11.1: 2.5e-6
  vreal ratio = ubs_log(opacity * (R(1.0) / least));
  vreal reach = R(2.0) * ratio + margin;
  if (UBS_FALLOFF == UBS_FALLOFF_BETA) {
    reach = V(1.0) - ubs_exp2(-UBS_LOG2E * ratio / beta) + margin;
    reach = ratio > V(0.0) ? reach : V(0.0);
  }
  return reach < (vreal)(UBS_SUPPORT) ? reach : (vreal)(UBS_SUPPORT);
}
