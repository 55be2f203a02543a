// SPDX-License-Identifier: Apache-2.0
// fit_skew_rotation() writes a spatial covariance R S^2 R^T as (I + A) diag(s^2) (I + A)^T with A =
// [omega]_x. The parameters of a splat represent its covariance in this way (docs/method.md, sections 2.1 and
// 5.4). Not every covariance can be written like this. For one that cannot, the function returns the most
// similar covariance that its search finds (see SkewFactors::error).
#pragma once

#include <array>

namespace ubs {

struct SkewFactors {
  std::array<double, 3> omega{};  // A = [omega]_x
  std::array<double, 3> scale{};  // s > 0
  // Frobenius norm of W'^(1/2) W^-1 W'^(1/2) - I, where W is the given covariance and W' is the returned one.
  // It is 0 if W' equals W; if it is 0.1, the variance along some axis is wrong by about 10 %.
  double error = 0;
  // Returns the first three values of the parameter l_triangle of the splat.
  std::array<double, 3> skew() const { return {-omega[2], omega[1], -omega[0]}; }
};

// Finds omega and s for a covariance. `rotation` is R as a quaternion (w, x, y, z) of unit length, and
// `scale` is the diagonal of S, the square roots of the eigenvalues. They must be positive.
SkewFactors fit_skew_rotation(const std::array<double, 4>& rotation, const std::array<double, 3>& scale);

}  // namespace ubs
