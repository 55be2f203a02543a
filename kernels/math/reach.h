// SPDX-License-Identifier: Apache-2.0
// Computes the squared distance r at which the alpha o (1 - r)^beta of a splat falls to the smallest alpha that
// contributes (UBS_LEAST_ALPHA). Only the part of the support within this distance affects the image. The result is
// never too small: it includes the distances at which alpha is only above the limit because of rounding errors.
#pragma once

// Returns r = 1 - (limit / o)^(1 / beta) for the Beta kernel and r = 2 ln(o / limit) for the Gaussian kernel, where o
// is the opacity, which must be above 0. The result is at most UBS_SUPPORT, where the support ends. It is 0 or negative
// if the splat has no effect anywhere. For kernels that the user has defined, the result is always UBS_SUPPORT, because
// the inverse of their expressions is not known. Only used with UBS_OPACITY_EXTENTS.
UBS_FN vreal splat_reach(vreal opacity, vreal beta) {
  if (UBS_FALLOFF == UBS_FALLOFF_OWN) return (vreal)(UBS_SUPPORT);
  // The rasteriser computes alpha with a relative error of at most 1.1e-5. This is the product of ln 2, the largest
  // exponent 20, and the error 7.5e-7 of the logarithm (kernels/math/elementary.h). So a splat cannot contribute to a
  // pixel if the exact alpha is below the limit by more than 2e-5 of the limit.
  real least = (UBS_OPACITY_EXTENTS ? UBS_LEAST_ALPHA : R(1.0)) * (R(1.0) - R(2e-5));
  // The margin is larger than the rounding errors of the following lines, which are 4e-7 for the Beta kernel and 2.5e-6
  // for the Gaussian kernel.
  real margin = R(4e-6);
  vreal ratio = ubs_log(opacity * (R(1.0) / least));
  vreal reach = R(2.0) * ratio + margin;
  if (UBS_FALLOFF == UBS_FALLOFF_BETA) {
    reach = V(1.0) - ubs_exp2(-UBS_LOG2E * ratio / beta) + margin;
    reach = ratio > V(0.0) ? reach : V(0.0);
  }
  return reach < (vreal)(UBS_SUPPORT) ? reach : (vreal)(UBS_SUPPORT);
}
