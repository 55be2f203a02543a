// SPDX-License-Identifier: Apache-2.0
// fit_skew_rotation() converts a spatial covariance R S^2 R^T to (I + A) diag(s^2) (I + A)^T with A =
// [omega]_x, the form of a splat's parameters (method.md 2.1, 5.4). Not every covariance has this form. If it
// does not, the function returns the nearest one that the search finds, measured in the metric of the
// covariance itself.
#pragma once

#include <array>

namespace ubs {

struct SkewFactors {
  std::array<double, 3> omega{};  // A = [omega]_x
  std::array<double, 3> scale{};  // s > 0
  // |W' W^-1 - I| of the whitened covariances (Frobenius). 0 means an exact representation; 0.1 means that
  // the variance along some axis is wrong by about 10%.
  double error = 0;
  std::array<double, 3> skew() const { return {-omega[2], omega[1], -omega[0]}; }  // l_triangle 0, 1, 2
};

// `rotation` is a quaternion w x y z of unit length; `scale` has the square roots of the eigenvalues, all
// positive.
SkewFactors fit_skew_rotation(const std::array<double, 4>& rotation, const std::array<double, 3>& scale);

}  // namespace ubs
