// SPDX-License-Identifier: Apache-2.0
// Computes the squared distance r at which the alpha of a splat falls to the smallest alpha that contributes
// (UBS_LEAST_ALPHA). Only the part of the support within this distance affects the image. The result is
// never too small: it includes the distances at which alpha is only above the limit because of rounding errors.
#pragma once

// Returns r = falloff_reach(ln(o / limit)), where o is the opacity, which must be above 0. The result is at most
// UBS_SUPPORT, where the support ends. It is 0 or negative if the splat has no effect anywhere. Only used with
// UBS_OPACITY_EXTENTS.
UBS_FN vreal splat_reach(vreal opacity, vreal beta) {
  // The rasteriser computes alpha with a relative error of at most 1.1e-5. This is the product of ln 2, the largest
  // exponent 20, and the error 7.5e-7 of the logarithm (kernels/math/elementary.h). So a splat cannot contribute to a
  // pixel if the exact alpha is below the limit by more than 2e-5 of the limit.
  real least = (UBS_OPACITY_EXTENTS ? UBS_LEAST_ALPHA : R(1.0)) * (R(1.0) - R(2e-5));
  // The margin is larger than the rounding errors of the following lines and of falloff_reach(), which are 4e-7 for the Beta kernel and 2.5e-6
  // for the Gaussian kernel.
  real margin = R(4e-6);
  vreal ratio = ubs_log(opacity * (R(1.0) / least));
  vreal reach = falloff_reach(ratio, beta, margin);
  return reach < (vreal)(UBS_SUPPORT) ? reach : (vreal)(UBS_SUPPORT);
}
