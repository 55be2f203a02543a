// SPDX-License-Identifier: Apache-2.0
// random_splats() creates random 3D Gaussians. They have the type ImportedSplats, which is used for
// third-party files. compare() returns the differences between two sets of such Gaussians.
#pragma once

#include <catch2/catch.hpp>
#include <cmath>

#include "host/base/philox.hpp"
#include "host/formats/foreign_formats.hpp"
#include "host/formats/imported_splats.hpp"
#include "host/scene/spatial_factor.hpp"

namespace ubs::test {

using Mat3 = Matrix3;

// Returns the covariance of a splat with the unit quaternion q = (w, x, y, z) and the scales s.
inline Mat3 covariance_of(const std::array<double, 4>& q, const std::array<double, 3>& s) {
  const auto [w, x, y, z] = q;
  const Mat3 r{{{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
                {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
                {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}}};
  Mat3 c{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      for (std::size_t k = 0; k < 3; ++k) c[i][j] += r[i][k] * r[j][k] * s[k] * s[k];
  return c;
}

// Returns the norm of a - b divided by the norm of a.
inline double relative_difference(const Mat3& a, const Mat3& b) {
  double d = 0, n = 0;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) {
      d += (a[i][j] - b[i][j]) * (a[i][j] - b[i][j]);
      n += a[i][j] * a[i][j];
    }
  return std::sqrt(d / n);
}

inline std::array<double, 4> random_rotation(const CounterRandom& random, std::uint32_t i) {
  std::array<double, 4> q{random.normal(i, 0), random.normal(i, 1), random.normal(i, 2), random.normal(i, 3)};
  const double n = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  for (double& v : q) v /= n;
  return q;
}

inline ImportedSplats random_splats(std::size_t count, int degree) {
  ImportedSplats s;
  s.sh_degree = degree;
  s.resize(count);
  const CounterRandom random(11, 1);
  for (std::uint32_t i = 0; i < count; ++i) {
    const auto q = random_rotation(random, i);
    for (std::uint32_t k = 0; k < 4; ++k) s.rotations[i][k] = static_cast<float>(q[k]);
    for (std::uint32_t k = 0; k < 3; ++k) {
      s.positions[i][k] = static_cast<float>(random.uniform(i, 10 + k, -3, 3));
      s.log_scales[i][k] = static_cast<float>(random.uniform(i, 14 + k, -5, -1));
    }
    s.opacity_logits[i] = static_cast<float>(random.uniform(i, 18, -3, 3));
  }
  for (std::uint32_t i = 0; i < s.sh.size(); ++i)
    s.sh[i] = static_cast<float>(random.uniform(i, 30, -0.9, 0.9));
  return s;
}

// The largest differences between two sets of splats. `rotation` is 1 minus the absolute value of the dot
// product of the quaternions, because quaternions with opposite signs are the same rotation. `dc` and `rest`
// are the spherical harmonics of degree 0 and of the higher degrees.
struct Differences {
  double position = 0, log_scale = 0, rotation = 0, opacity = 0, dc = 0, rest = 0;
};

inline Differences compare(const ImportedSplats& a, const ImportedSplats& b) {
  REQUIRE(a.count() == b.count());
  Differences d;
  const auto worst = [](double& at, double v) { at = std::max(at, std::abs(v)); };
  for (std::size_t i = 0; i < a.count(); ++i) {
    double dot = 0;
    for (std::size_t k = 0; k < 4; ++k) dot += a.rotations[i][k] * b.rotations[i][k];
    worst(d.rotation, 1 - std::abs(dot));
    worst(d.opacity, sigmoid_of(a.opacity_logits[i]) - sigmoid_of(b.opacity_logits[i]));
    for (std::size_t k = 0; k < 3; ++k) {
      worst(d.position, a.positions[i][k] - b.positions[i][k]);
      worst(d.log_scale, a.log_scales[i][k] - b.log_scales[i][k]);
      worst(d.dc, a.sh[i * 3 * a.coefficients() + k] - b.sh[i * 3 * b.coefficients() + k]);
    }
    if (a.sh_degree == b.sh_degree)
      for (std::size_t k = 3; k < 3 * a.coefficients(); ++k)
        worst(d.rest, a.sh[i * 3 * a.coefficients() + k] - b.sh[i * 3 * a.coefficients() + k]);
  }
  return d;
}

}  // namespace ubs::test
