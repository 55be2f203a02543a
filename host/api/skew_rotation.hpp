// SPDX-License-Identifier: Apache-2.0
// Writes a spatial covariance R S^2 R^T as (I + A) diag(s^2) (I + A)^T with A = [omega]_x, the form of a
// splat's parameters (method.md 2.1, 5.4). Not every covariance has that form; then the nearest one that
// the search finds, in the metric of the covariance itself.
#pragma once

#include <array>

namespace ubs {

struct SkewFactors {
  std::array<double, 3> omega{};  // A = [omega]_x
  std::array<double, 3> scale{};  // s > 0
  // |W' W^-1 - I| of the whitened covariances (Frobenius): 0 for an exact representation, 0.1 for about
  // 10% wrong variance along some axis.
  double error = 0;
  std::array<double, 3> skew() const { return {-omega[2], omega[1], -omega[0]}; }  // l_triangle 0, 1, 2
};

// Quaternion w x y z of unit length; scales are the square roots of the eigenvalues, all positive.
SkewFactors fit_skew_rotation(const std::array<double, 4>& rotation, const std::array<double, 3>& scale);

}  // namespace ubs
