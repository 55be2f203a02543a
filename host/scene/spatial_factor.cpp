// SPDX-License-Identifier: Apache-2.0
// See spatial_factor.hpp.
#include "host/scene/spatial_factor.hpp"

#include <algorithm>
#include <cmath>

namespace ubs {
namespace {

// R = I + f A + g A^2 with the f and g of kernels/math/rotation.h; t = |omega|^2.
struct Factors {
  double f, g;
};

Factors rotation_factors(RotMode mode, double t) {
  switch (mode) {
    case RotMode::taylor2:
      return {1, 0.5};
    case RotMode::cayley:
      return {2 / (1 + t), 2 / (1 + t)};
    case RotMode::exp: {
      if (t < 1e-8) return {1 - t / 6, 0.5 - t / 24};  // the rest is below 1e-18
      const double angle = std::sqrt(t), half = std::sin(0.5 * angle);
      return {std::sin(angle) / angle, 2 * half * half / t};
    }
    default:
      return {1, 0};
  }
}

Matrix3 skew_rotation(RotMode mode, double a0, double a1, double a2) {
  const Matrix3 a{{{0, a0, a1}, {-a0, 0, a2}, {-a1, -a2, 0}}};
  const auto [f, g] = rotation_factors(mode, a0 * a0 + a1 * a1 + a2 * a2);
  Matrix3 r{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) {
      double square = 0;
      for (std::size_t k = 0; k < 3; ++k) square += a[i][k] * a[k][j];
      r[i][j] = (i == j ? 1.0 : 0.0) + f * a[i][j] + g * square;
    }
  return r;
}

}  // namespace

double softplus_of(double raw) { return raw > 20 ? raw : std::log1p(std::exp(raw)); }

double inverse_softplus_of(double y) {
  y = std::max(y, 1e-30);
  return y > 20 ? y : y + std::log(-std::expm1(-y));
}

Matrix3 quaternion_matrix(const std::array<double, 4>& q) {
  const double n = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  const double w = q[0] / n, x = q[1] / n, y = q[2] / n, z = q[3] / n;
  return {{{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
           {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
           {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}}};
}

Matrix3 spatial_factor(const SplatModel& model, std::size_t splat) {
  const ParameterLayout l = model.layout();
  const auto at = [&](int row) { return static_cast<double>(model.row(row)[splat]); };
  const double a[4] = {at(l.l_triangle), at(l.l_triangle + 1), at(l.l_triangle + 2),
                       l.variant.rot_mode == RotMode::quaternion ? at(l.l_triangle + 3) : 0};
  Matrix3 m = l.variant.cov_param == CovParam::cholesky ? Matrix3{{{1, 0, 0}, {a[0], 1, 0}, {a[1], a[2], 1}}}
              : l.variant.rot_mode == RotMode::quaternion
                  ? quaternion_matrix({a[0], a[1], a[2], a[3]})
                  : skew_rotation(l.variant.rot_mode, a[0], a[1], a[2]);
  for (std::size_t r = 0; r < 3; ++r)
    for (std::size_t c = 0; c < 3; ++c)
      if (l.variant.cov_param != CovParam::cholesky || r == c)
        m[r][c] *= softplus_of(at(l.scale + static_cast<int>(c)));
  return m;
}

}  // namespace ubs
