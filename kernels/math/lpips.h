// SPDX-License-Identifier: Apache-2.0
// Computes LPIPS for one pixel of one feature layer (Zhang et al. 2018, version 0.1). The feature vectors a and b of
// two images are scaled to unit length, and the weighted squares of their difference are summed over channels:
//   d = sum_c w_c (a_c / (|a| + 1e-10) - b_c / (|b| + 1e-10))^2.
#pragma once

// Returns 1 / (|a| + 1e-10) from |a|^2. If all features of a pixel are zero, they remain zero after the scaling.
UBS_FN vreal lpips_inverse_norm(vreal square) { return V(1.0) / (ubs_sqrt(square) + R(1e-10)); }

// Returns the term of one channel. Each product has its own statement. OpenCL does not fuse operations of different
// statements, so it rounds both products, and the distance of equal features is exactly 0. nvcc may fuse one of the
// products with the difference. Then only the other product is rounded, and equal features have a distance of about
// 1e-15.
UBS_FN vreal lpips_term(real weight, vreal a, vreal inverse_a, vreal b, vreal inverse_b) {
  vreal unit_a = a * inverse_a;
  vreal unit_b = b * inverse_b;
  vreal difference = unit_a - unit_b;
  return weight * (difference * difference);
}
