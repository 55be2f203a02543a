// SPDX-License-Identifier: Apache-2.0
// Computes the squared distance r at which the alpha o (1 - r)^beta of a splat falls to the smallest alpha that
// contributes (UBS_LEAST_ALPHA). Only the part of the support within this distance affects the image. The result is
// never too small: it also covers alphas that rounding lifts above the limit.
#pragma once

// Requires opacity > 0. Beta: r = 1 - (limit / o)^(1 / beta); Gaussian: r = 2 ln(o / limit). The result is at most
// UBS_SUPPORT, where the support ends, and 0 or negative if the splat has no effect anywhere. Used only with
// UBS_OPACITY_EXTENTS. Expressions of the user have no inverse, so that their splats always reach the end.
UBS_FN vreal splat_reach(vreal opacity, vreal beta) {
  if (UBS_FALLOFF == UBS_FALLOFF_OWN) return (vreal)(UBS_SUPPORT);
  // The rasteriser computes alpha with a relative error of at most 1.1e-5 (an exponent of at most 20, times ln 2, times
  // 7.5e-7; see kernels/math/elementary.h). So no alpha contributes if the exact alpha is below the limit by more than
  // 2e-5.
  real least = (UBS_OPACITY_EXTENTS ? UBS_LEAST_ALPHA : R(1.0)) * (R(1.0) - R(2e-5));
  real margin = R(4e-6);  // rounding of the following lines: 4e-7; Gaussian, where r is up to 11.1: 2.5e-6
  vreal ratio = ubs_log(opacity * (R(1.0) / least));
  vreal reach = R(2.0) * ratio + margin;
  if (UBS_FALLOFF == UBS_FALLOFF_BETA) {
    reach = V(1.0) - ubs_exp2(-UBS_LOG2E * ratio / beta) + margin;
    reach = ratio > V(0.0) ? reach : V(0.0);
  }
  return reach < (vreal)(UBS_SUPPORT) ? reach : (vreal)(UBS_SUPPORT);
}
