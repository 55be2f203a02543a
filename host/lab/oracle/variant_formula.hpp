// SPDX-License-Identifier: Apache-2.0
// This file contains the formulas of the oracle for parts of the method that variants replace. Rotations are
// computed from their definitions, not from closed forms, and spherical harmonics from their normalisation
// constants.
#pragma once

#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "host/lab/oracle/matrix.hpp"
#include "host/scene/model_variant.hpp"

namespace ubs::oracle {

template <class S, class Factor>
Matrix<S> scaled(Matrix<S> a, const Factor& factor) {
  for (int i = 0; i < a.rows(); ++i)
    for (int j = 0; j < a.columns(); ++j) a(i, j) = factor * a(i, j);
  return a;
}

// Returns the rotation for the skew matrix A: taylor1 is I + A, taylor2 is I + A + A^2/2, cayley is (I -
// A)^-1 (I + A), and exp is the exponential by its power series.
template <class S>
Matrix<S> skew_rotation(const Matrix<S>& a, RotMode mode) {
  const Matrix<S> one = Matrix<S>::identity(3);
  if (mode == RotMode::taylor1) return one + a;
  if (mode == RotMode::taylor2) return one + a + scaled(a * a, 0.5);
  if (mode == RotMode::cayley) return inverse(one - a) * (one + a);
  Matrix<S> sum = one, term = one;
  for (int n = 1; n <= 40; ++n) {
    term = scaled(term * a, 1.0 / n);
    sum = sum + term;
  }
  return sum;
}

// Returns the rotation v -> q v q* / |q|^2 for a quaternion q = (w, x, y, z) of any length. If |q| is at most
// 1e-12, the formula uses 1e-12 instead of |q|: R = I + 2 (w [v] + [v]^2) / 1e-24, where [v] is the cross
// product matrix of (x, y, z). For q = 0 this is the identity. This avoids a division by 0.
template <class S>
Matrix<S> quaternion_rotation(const std::array<S, 4>& q) {
  const S& w = q[0];
  const S &x = q[1], &y = q[2], &z = q[3];
  const S n = w * w + x * x + y * y + z * z;
  if (value(n) <= 1e-24) {
    Matrix<S> v(3, 3);
    v(1, 2) = -x, v(2, 1) = x, v(0, 2) = y, v(2, 0) = -y, v(0, 1) = -z, v(1, 0) = z;
    return Matrix<S>::identity(3) + scaled(scaled(Matrix<S>::identity(3), w) * v + v * v, 2e24);
  }
  Matrix<S> r(3, 3);
  r(0, 0) = (w * w + x * x - y * y - z * z) / n;
  r(1, 1) = (w * w - x * x + y * y - z * z) / n;
  r(2, 2) = (w * w - x * x - y * y + z * z) / n;
  r(0, 1) = 2.0 * (x * y - w * z) / n, r(1, 0) = 2.0 * (x * y + w * z) / n;
  r(0, 2) = 2.0 * (x * z + w * y) / n, r(2, 0) = 2.0 * (x * z - w * y) / n;
  r(1, 2) = 2.0 * (y * z - w * x) / n, r(2, 1) = 2.0 * (y * z + w * x) / n;
  return r;
}

// Returns the first `count` real spherical harmonics of a unit vector, in the order l = 0, 1, ... and, for
// each l, m = -l .. l. As in 3D Gaussian Splatting, they have the Condon-Shortley phase, so the terms of odd
// m are negative.
template <class S>
std::vector<S> spherical_harmonics(const std::array<S, 3>& d, int count) {
  const S &x = d[0], &y = d[1], &z = d[2];
  const auto root = [](double quotient) { return std::sqrt(quotient / std::numbers::pi); };
  std::vector<S> all{S(0.5 * root(1)),
                     -(root(3.0 / 4) * y),
                     root(3.0 / 4) * z,
                     -(root(3.0 / 4) * x),
                     root(15.0 / 4) * x * y,
                     -(root(15.0 / 4) * y * z),
                     root(5.0 / 16) * (2.0 * z * z - x * x - y * y),
                     -(root(15.0 / 4) * x * z),
                     root(15.0 / 16) * (x * x - y * y),
                     -(root(35.0 / 32) * y * (3.0 * x * x - y * y)),
                     root(105.0 / 4) * x * y * z,
                     -(root(21.0 / 32) * y * (4.0 * z * z - x * x - y * y)),
                     root(7.0 / 16) * z * (2.0 * z * z - 3.0 * x * x - 3.0 * y * y),
                     -(root(21.0 / 32) * x * (4.0 * z * z - x * x - y * y)),
                     root(105.0 / 16) * z * (x * x - y * y),
                     -(root(35.0 / 32) * x * (x * x - 3.0 * y * y))};
  all.resize(static_cast<std::size_t>(count));
  return all;
}

}  // namespace ubs::oracle
