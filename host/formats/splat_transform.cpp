// SPDX-License-Identifier: Apache-2.0
// See splat_transform.hpp. CMake compiles this file separately, because it selects a variant of the formulas
// in kernels/math.
#include "host/formats/splat_transform.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "host/base/error.hpp"
#include "host/formats/covariance_axes.hpp"
#include "host/scene/pose.hpp"

// clang-format off
#define UBS_N 3
#define UBS_COLOUR 4  // spherical harmonics up to degree 3
#include "kernels/dialect/dialect.h"
#include "kernels/limits.h"
#include "kernels/layout.h"
#include "kernels/math/elementary.h"
#include "kernels/math/rotation.h"
#include "kernels/math/colour.h"
// clang-format on

namespace ubs {
namespace {

// Numbers of a transformation are treated as those of the identity, or of a similarity, if they differ by at
// most this much. This allows a few rounding errors of float32 numbers near 1.
constexpr double kRounding = 1e-6;
constexpr std::size_t kHarmonics = 16;

using HarmonicMatrix = std::array<std::array<double, kHarmonics>, kHarmonics>;

Matrix3 product_of(const Matrix3& a, const Matrix3& b) {
  Matrix3 c{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      for (std::size_t k = 0; k < 3; ++k) c[i][j] += a[i][k] * b[k][j];
  return c;
}

Vec3 applied(const Matrix3& m, const Vec3& v) { return {dot(m[0], v), dot(m[1], v), dot(m[2], v)}; }

Matrix3 transpose_of(const Matrix3& m) {
  return {{{m[0][0], m[1][0], m[2][0]}, {m[0][1], m[1][1], m[2][1]}, {m[0][2], m[1][2], m[2][2]}}};
}

double determinant(const Matrix3& m) { return dot(m[0], cross(m[1], m[2])); }

// Returns whether a - b is at most kRounding times `unit` in every element.
bool nearly(const Matrix3& a, const Matrix3& b, double unit) {
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      if (!(std::abs(a[i][j] - b[i][j]) <= kRounding * unit)) return false;
  return true;
}

Matrix3 diagonal(double v) { return {{{v, 0, 0}, {0, v, 0}, {0, 0, v}}}; }

// Returns the transposed inverse, or nothing if the matrix is singular. The rows are divided by their lengths
// first, so that the decision does not depend on the unit of length.
std::optional<Matrix3> cotransposed(const Matrix3& m) {
  const Matrix3 cofactors{{cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1])}};
  const double det = determinant(m), size = length(m[0]) * length(m[1]) * length(m[2]);
  if (!(std::abs(det) > 1e-12 * size)) return {};
  Matrix3 out;
  for (std::size_t i = 0; i < 3; ++i) out[i] = (1 / det) * cofactors[i];
  return out;
}

// Returns the orthogonal matrix that is nearest to a matrix that is not singular (its polar factor), by
// Newton's iteration X <- (s X + (s X)^-T) / 2. The factor s makes the determinants of both terms equal.
Matrix3 nearest_orthogonal(Matrix3 m) {
  constexpr int kSteps = 60;  // sufficient for condition numbers up to 1e12; usually less than 10 are needed
  for (int step = 0; step < kSteps; ++step) {
    const std::optional<Matrix3> other = cotransposed(m);
    if (!other) break;
    const double s = std::cbrt(1 / std::abs(determinant(m)));
    Matrix3 next;
    for (std::size_t i = 0; i < 3; ++i) next[i] = 0.5 * (s * m[i] + (1 / s) * (*other)[i]);
    const bool done = nearly(next, m, 1e-9);
    m = next;
    if (done) break;
  }
  return m;
}

std::array<double, kHarmonics> harmonics_at(const Vec3& direction) {
  const ShBasis basis = sh_basis({{direction[0], direction[1], direction[2]}});
  std::array<double, kHarmonics> out;
  std::copy_n(basis.e, kHarmonics, out.begin());
  return out;
}

// Returns the matrix that maps the coefficients of a function f(d) to those of f(O^T d), where O is an
// orthogonal matrix. Its element (j, k) is the integral of Y_j(d) Y_k(O^T d) over the sphere. The integrand
// is a polynomial of degree 6 at most, for which this quadrature is exact: four nodes of Gauss and Legendre
// along z, and seven equal steps around z.
HarmonicMatrix harmonic_matrix(const Matrix3& orthogonal) {
  constexpr double kNodes[] = {-0.86113631159405257522, -0.33998104358485626480, 0.33998104358485626480,
                               0.86113631159405257522};
  constexpr double kWeights[] = {0.34785484513745385737, 0.65214515486254614263, 0.65214515486254614263,
                                 0.34785484513745385737};
  constexpr int kSteps = 7;
  const Matrix3 back = transpose_of(orthogonal);
  HarmonicMatrix out{};
  for (std::size_t n = 0; n < 4; ++n)
    for (int step = 0; step < kSteps; ++step) {
      const double angle = 2 * std::numbers::pi * step / kSteps,
                   radius = std::sqrt(1 - kNodes[n] * kNodes[n]);
      const Vec3 d{radius * std::cos(angle), radius * std::sin(angle), kNodes[n]};
      const double weight = kWeights[n] * 2 * std::numbers::pi / kSteps;
      const auto y = harmonics_at(d), turned = harmonics_at(applied(back, d));
      for (std::size_t j = 0; j < kHarmonics; ++j)
        for (std::size_t k = 0; k < kHarmonics; ++k) out[j][k] += weight * y[j] * turned[k];
    }
  return out;
}

void rotate_harmonics(ImportedSplats& splats, const Matrix3& orthogonal) {
  if (splats.sh_degree == 0) return;
  if (splats.sh_degree > 3 || splats.lobes > 0)
    fail(ErrorKind::internal, "only spherical harmonics up to degree 3 can be rotated");
  const HarmonicMatrix matrix = harmonic_matrix(orthogonal);
  const std::size_t n = splats.coefficients();
  for (std::size_t i = 0; i < splats.count(); ++i) {
    float* const sh = &splats.sh[i * 3 * n];
    for (std::size_t c = 0; c < 3; ++c) {
      std::array<double, kHarmonics> old{};
      for (std::size_t k = 0; k < n; ++k) old[k] = sh[3 * k + c];
      for (std::size_t degree = 1, first = 1; first < n; ++degree, first = degree * degree)
        for (std::size_t j = first; j < first + 2 * degree + 1; ++j) {
          double sum = 0;  // the matrix does not mix harmonics of different degrees
          for (std::size_t k = first; k < first + 2 * degree + 1; ++k) sum += matrix[j][k] * old[k];
          sh[3 * j + c] = static_cast<float>(sum);
        }
    }
  }
}

Matrix3 matrix_of(const Quaternion& q) {
  const std::array<double, 9> m = matrix(q);
  return {{{m[0], m[1], m[2]}, {m[3], m[4], m[5]}, {m[6], m[7], m[8]}}};
}

std::optional<Quaternion> unit_rotation(const std::array<float, 4>& q) {
  const double norm =
      std::sqrt(double{q[0]} * q[0] + double{q[1]} * q[1] + double{q[2]} * q[2] + double{q[3]} * q[3]);
  if (!(norm > 1e-10) || !std::isfinite(norm)) return {};
  return Quaternion{q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm};
}

// Multiplies the rotations by a rotation from the left, and the scales by `scale`.
void rotate_axes(ImportedSplats& splats, const Quaternion& by, double scale) {
  const auto more = static_cast<float>(std::log(scale));
  for (std::size_t i = 0; i < splats.count(); ++i) {
    for (float& s : splats.log_scales[i]) s += more;
    auto& r = splats.rotations[i];
    const double w = r[0], x = r[1], y = r[2], z = r[3];
    r = {static_cast<float>(by.w * w - by.x * x - by.y * y - by.z * z),
         static_cast<float>(by.w * x + by.x * w + by.y * z - by.z * y),
         static_cast<float>(by.w * y - by.x * z + by.y * w + by.z * x),
         static_cast<float>(by.w * z + by.x * y - by.y * x + by.z * w)};
  }
}

// Replaces every covariance C by L C L^T. Splats whose rotation or scale cannot be used are left as they are,
// so that clean() drops them.
void distort_axes(ImportedSplats& splats, const Matrix3& linear) {
  for (std::size_t i = 0; i < splats.count(); ++i) {
    const std::optional<Quaternion> q = unit_rotation(splats.rotations[i]);
    const auto usable = [](float s) { return s < 100; };  // also false for NaN
    if (!q || !std::ranges::all_of(splats.log_scales[i], usable)) continue;
    Matrix3 factor = product_of(linear, matrix_of(*q));
    for (auto& row : factor)
      for (std::size_t k = 0; k < 3; ++k) row[k] *= std::exp(double{splats.log_scales[i][k]});
    const CovarianceAxes axes = covariance_axes(factor);
    for (std::size_t k = 0; k < 4; ++k) splats.rotations[i][k] = static_cast<float>(axes.rotation[k]);
    for (std::size_t k = 0; k < 3; ++k)
      splats.log_scales[i][k] =
          static_cast<float>(std::max(0.5 * std::log(axes.variance[k]), double{kFlatLogScale}));
  }
}

}  // namespace

Affine operator*(const Affine& outer, const Affine& inner) {
  return {product_of(outer.linear, inner.linear), applied(outer.linear, inner.move) + outer.move};
}

std::optional<Affine> inverse(const Affine& affine) {
  const std::optional<Matrix3> other = cotransposed(affine.linear);
  if (!other) return {};
  const Matrix3 linear = transpose_of(*other);
  return Affine{linear, -1.0 * applied(linear, affine.move)};
}

bool is_finite(const Affine& affine) {
  const auto finite = [](const Vec3& v) {
    return std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2]);
  };
  return std::ranges::all_of(affine.linear, finite) && finite(affine.move);
}

bool is_affine_row(double a, double b, double c, double d) {
  return std::abs(a) <= kRounding && std::abs(b) <= kRounding && std::abs(c) <= kRounding &&
         std::abs(d - 1) <= kRounding;
}

Affine translation(const Vec3& by) { return {.move = by}; }

Affine scaling(const Vec3& by) { return {.linear = {{{by[0], 0, 0}, {0, by[1], 0}, {0, 0, by[2]}}}}; }

Affine rotation(const std::array<double, 4>& q) {
  const double norm = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  return {.linear = matrix_of({q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm})};
}

Affine half_turned(const Affine& affine) {
  constexpr double kSigns[] = {1, -1, -1};
  Affine out = affine;
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j)
      if (kSigns[i] != kSigns[j]) out.linear[i][j] = 0 - out.linear[i][j];
    if (kSigns[i] < 0) out.move[i] = 0 - out.move[i];
  }
  return out;
}

void transform_splats(ImportedSplats& splats, const Affine& affine) {
  const Matrix3& linear = affine.linear;
  if (nearly(linear, diagonal(1), 1)) {
    splats.offset = splats.offset + affine.move;
    return;
  }
  splats.offset = applied(linear, splats.offset) + affine.move;
  for (auto& p : splats.positions) {
    const Vec3 moved = applied(linear, {p[0], p[1], p[2]});
    for (std::size_t k = 0; k < 3; ++k) p[k] = static_cast<float>(moved[k]);
  }
  // L^T L is a multiple of the identity if L is a rotation or reflection with a uniform scale.
  const Matrix3 square = product_of(transpose_of(linear), linear);
  const double variance = (square[0][0] + square[1][1] + square[2][2]) / 3;
  const Matrix3 orthogonal = nearest_orthogonal(linear);
  if (nearly(square, diagonal(variance), variance)) {
    // A Gaussian is symmetric, so a reflection O changes it like the rotation -O.
    const double sign = determinant(orthogonal) < 0 ? -1 : 1;
    RotationMatrix turn{};
    for (std::size_t k = 0; k < 9; ++k) turn[k] = sign * orthogonal[k / 3][k % 3];
    rotate_axes(splats, quaternion(turn), std::sqrt(variance));
  } else {
    distort_axes(splats, linear);
    if (splats.sh_degree > 0)
      splats.report.note(
          "a transformation scales the axes differently or shears: the shapes of the splats are exact, but "
          "the dependence of their colours on the direction is only rotated");
  }
  rotate_harmonics(splats, orthogonal);
}

}  // namespace ubs
