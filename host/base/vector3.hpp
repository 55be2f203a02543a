// SPDX-License-Identifier: Apache-2.0
// These functions are the vector arithmetic for camera poses. They work on the array types that Camera uses.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

namespace ubs {

using Vec3 = std::array<double, 3>;

inline Vec3 operator+(const Vec3& a, const Vec3& b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }
inline Vec3 operator-(const Vec3& a, const Vec3& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
inline Vec3 operator*(double s, const Vec3& a) { return {s * a[0], s * a[1], s * a[2]}; }
inline double dot(const Vec3& a, const Vec3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline double length(const Vec3& a) { return std::hypot(a[0], a[1], a[2]); }
inline Vec3 cross(const Vec3& a, const Vec3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

// Returns the vector scaled to unit length, or `otherwise` if it is too short to have a direction.
inline Vec3 normalised(const Vec3& a, const Vec3& otherwise = {0, 0, 1}) {
  const double l = length(a);
  return l > 1e-12 ? (1 / l) * a : otherwise;
}

using RotationMatrix = std::array<double, 9>;  // row-major

inline RotationMatrix transposed(const RotationMatrix& r) {
  return {r[0], r[3], r[6], r[1], r[4], r[7], r[2], r[5], r[8]};
}

inline RotationMatrix product(const RotationMatrix& a, const RotationMatrix& b) {
  RotationMatrix out{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      for (std::size_t k = 0; k < 3; ++k) out[3 * i + j] += a[3 * i + k] * b[3 * k + j];
  return out;
}

inline Vec3 rotated(const RotationMatrix& r, const Vec3& v) {
  return {r[0] * v[0] + r[1] * v[1] + r[2] * v[2], r[3] * v[0] + r[4] * v[1] + r[5] * v[2],
          r[6] * v[0] + r[7] * v[1] + r[8] * v[2]};
}

// Returns a unit vector that is perpendicular to the unit vector `a`.
inline Vec3 perpendicular(const Vec3& a) {
  return normalised(cross(a, std::abs(a[0]) < 0.6 ? Vec3{1, 0, 0} : Vec3{0, 1, 0}));
}

}  // namespace ubs
