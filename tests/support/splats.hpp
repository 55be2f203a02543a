// SPDX-License-Identifier: Apache-2.0
// random_splats() creates random 3D Gaussians. They have the type ImportedSplats, which is used for
// third-party files. compare() returns the differences between two sets of such Gaussians, and colours_from()
// their colours. check_transformed() tests splats that a node of a scene has transformed.
#pragma once

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <vector>

#include "host/base/philox.hpp"
#include "host/base/vector3.hpp"
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

// Computes the real spherical harmonics of the unit vector d, with the signs and the order of 3DGS.
inline void sh_basis(const std::array<double, 3>& d, int degree, double* b) {
  const double x = d[0], y = d[1], z = d[2], xx = x * x, yy = y * y, zz = z * z;
  b[0] = kShC0;
  if (degree < 1) return;
  b[1] = -0.4886025119029199 * y;
  b[2] = 0.4886025119029199 * z;
  b[3] = -0.4886025119029199 * x;
  if (degree < 2) return;
  b[4] = 1.0925484305920792 * x * y;
  b[5] = -1.0925484305920792 * y * z;
  b[6] = 0.31539156525252005 * (2 * zz - xx - yy);
  b[7] = -1.0925484305920792 * x * z;
  b[8] = 0.5462742152960396 * (xx - yy);
  if (degree < 3) return;
  b[9] = -0.5900435899266435 * y * (3 * xx - yy);
  b[10] = 2.890611442640554 * x * y * z;
  b[11] = -0.4570457994644658 * y * (4 * zz - xx - yy);
  b[12] = 0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy);
  b[13] = -0.4570457994644658 * x * (4 * zz - xx - yy);
  b[14] = 1.445305721320277 * z * (xx - yy);
  b[15] = -0.5900435899266435 * x * (xx - 3 * yy);
}

// Returns the colours as seen from `centre`: max(0, SH(direction) + 0.5), as in 3DGS. They may exceed 1.
inline std::vector<std::array<float, 3>> colours_from(const ImportedSplats& s,
                                                      const std::array<double, 3>& centre) {
  std::vector<std::array<float, 3>> colours(s.count());
  const int degree = std::min(s.sh_degree, 3);
  const std::size_t used = static_cast<std::size_t>((degree + 1) * (degree + 1)), all = s.coefficients();
  for (std::size_t i = 0; i < s.count(); ++i) {
    std::array<double, 3> d{};
    for (std::size_t k = 0; k < 3; ++k) d[k] = s.positions[i][k] - centre[k];
    const double length = std::max(1e-12, std::hypot(d[0], d[1], d[2]));
    for (double& v : d) v /= length;
    double basis[16];
    sh_basis(d, degree, basis);
    for (std::size_t c = 0; c < 3; ++c) {
      double value = 0.5;
      for (std::size_t k = 0; k < used; ++k) value += basis[k] * s.sh[(i * all + k) * 3 + c];
      colours[i][c] = static_cast<float>(std::max(0.0, value));
    }
  }
  return colours;
}

// Compares splats with the result of the transformation x -> m x + move. With `turned`, m and move are in
// axes with y up, and the splats in those of PLY files. Returns the largest relative difference of a
// covariance. Positions are compared, too, and so are the colours as seen from the transformed viewpoint if m
// is a rotation with a uniform scale.
inline double check_transformed(const ImportedSplats& before, const ImportedSplats& after, Mat3 m, Vec3 move,
                                bool similar, bool turned = true) {
  const auto sign = [turned](std::size_t k) { return turned && k > 0 ? -1.0 : 1.0; };
  for (std::size_t r = 0; r < 3; ++r) {
    for (std::size_t c = 0; c < 3; ++c) m[r][c] *= sign(r) * sign(c);
    move[r] *= sign(r);
  }
  const auto moved = [&](const Vec3& p) { return Vec3{dot(m[0], p), dot(m[1], p), dot(m[2], p)} + move; };
  const auto covariance = [](const ImportedSplats& s, std::size_t i) {
    const auto& q = s.rotations[i];
    const auto& l = s.log_scales[i];
    return covariance_of({q[0], q[1], q[2], q[3]}, {std::exp(l[0]), std::exp(l[1]), std::exp(l[2])});
  };
  REQUIRE(after.count() == before.count());
  double worst = 0;
  for (std::size_t i = 0; i < before.count(); ++i) {
    const auto& p = before.positions[i];
    const Vec3 expected = moved({p[0], p[1], p[2]});
    for (std::size_t k = 0; k < 3; ++k)
      CHECK(after.positions[i][k] + after.offset[k] == Approx(expected[k]).margin(1e-5));
    const Mat3 old = covariance(before, i);
    Mat3 whole{};
    for (std::size_t a = 0; a < 3; ++a)
      for (std::size_t b = 0; b < 3; ++b)
        for (std::size_t k = 0; k < 3; ++k)
          for (std::size_t l = 0; l < 3; ++l) whole[a][b] += m[a][k] * old[k][l] * m[b][l];
    worst = std::max(worst, relative_difference(whole, covariance(after, i)));
  }
  for (std::size_t i = 0; i < before.count(); ++i)
    CHECK(after.opacity_logits[i] == Approx(before.opacity_logits[i]).margin(1e-5));
  const Vec3 viewpoint{9, -8, 7};
  const auto a = colours_from(before, viewpoint), b = colours_from(after, moved(viewpoint) - after.offset);
  double colour = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    for (std::size_t c = 0; c < 3; ++c) colour = std::max(colour, double{std::abs(a[i][c] - b[i][c])});
  if (similar) CHECK(colour < 3e-6);
  return worst;
}

// Returns the rotation matrix of a quaternion w x y z with any length, times a scale.
inline Mat3 turn_matrix(std::array<double, 4> q, double scale = 1) {
  const double n = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  for (double& v : q) v /= n;
  const auto [w, x, y, z] = q;
  Mat3 m{{{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
          {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
          {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}}};
  for (auto& row : m) row = scale * row;
  return m;
}

}  // namespace ubs::test
