// SPDX-License-Identifier: Apache-2.0
// The little vector arithmetic that camera poses need, on the arrays that Camera is made of.
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

// Unit length; `otherwise` for vectors too short to have a direction.
inline Vec3 normalised(const Vec3& a, const Vec3& otherwise = {0, 0, 1}) {
  const double l = length(a);
  return l > 1e-12 ? (1 / l) * a : otherwise;
}

// A unit vector at right angles to the unit vector `a`.
inline Vec3 perpendicular(const Vec3& a) {
  return normalised(cross(a, std::abs(a[0]) < 0.6 ? Vec3{1, 0, 0} : Vec3{0, 1, 0}));
}

}  // namespace ubs
