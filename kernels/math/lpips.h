// SPDX-License-Identifier: Apache-2.0
// LPIPS at one pixel of one tap (Zhang et al. 2018, version 0.1): the feature vectors a and b of two images
// are scaled to unit length, and the weighted square of their difference is summed over channels:
//   d = sum_c w_c (a_c / (|a| + 1e-10) - b_c / (|b| + 1e-10))^2.
#pragma once

// 1 / (|a| + epsilon) from |a|^2; a pixel without any feature stays zero.
UBS_FN vreal lpips_inverse_norm(vreal square) { return V(1.0) / (ubs_sqrt(square) + R(1e-10)); }

// In statements of their own, so that OpenCL rounds both products: equal features have distance 0.
UBS_FN vreal lpips_term(real weight, vreal a, vreal inverse_a, vreal b, vreal inverse_b) {
  vreal unit_a = a * inverse_a;
  vreal unit_b = b * inverse_b;
  vreal difference = unit_a - unit_b;
  return weight * (difference * difference);
}
