// SPDX-License-Identifier: Apache-2.0
// Vec3 holds three doubles for the procedural scenes: a position, a direction or a colour. Its scalar product
// is summed in the order x, y, z.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

namespace ubs::synthetic {

struct Vec3 {
  std::array<double, 3> e{};

  Vec3() = default;
  Vec3(double x, double y, double z) : e{x, y, z} {}
  static Vec3 all(double v) { return {v, v, v}; }

  double& operator[](int i) { return e[static_cast<std::size_t>(i)]; }
  double operator[](int i) const { return e[static_cast<std::size_t>(i)]; }
  bool operator==(const Vec3&) const = default;

  Vec3& operator+=(const Vec3& b) { return *this = {e[0] + b[0], e[1] + b[1], e[2] + b[2]}; }
  Vec3& operator*=(double s) { return *this = {e[0] * s, e[1] * s, e[2] * s}; }
  double dot(const Vec3& b) const { return e[0] * b[0] + e[1] * b[1] + e[2] * b[2]; }
  Vec3 cross(const Vec3& b) const {
    return {e[1] * b[2] - e[2] * b[1], e[2] * b[0] - e[0] * b[2], e[0] * b[1] - e[1] * b[0]};
  }
  Vec3 mul(const Vec3& b) const { return {e[0] * b[0], e[1] * b[1], e[2] * b[2]}; }  // by component
};

inline Vec3 operator+(Vec3 a, const Vec3& b) { return a += b; }
inline Vec3 operator-(const Vec3& a, const Vec3& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
inline Vec3 operator-(const Vec3& a) { return {-a[0], -a[1], -a[2]}; }
inline Vec3 operator*(Vec3 a, double s) { return a *= s; }
inline Vec3 operator*(double s, Vec3 a) { return a *= s; }
inline double norm(const Vec3& a) { return std::sqrt(a.dot(a)); }
// Returns a vector of length 1 in the direction of `a`. The result is zero if `a` is zero.
inline Vec3 normalize(const Vec3& a) {
  const double length = norm(a);
  return a * (length != 0 ? 1 / length : 0.0);
}

}  // namespace ubs::synthetic
