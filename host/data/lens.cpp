// SPDX-License-Identifier: Apache-2.0
// See lens.hpp. OpenCV has only two of the models (calib3d, fisheye) and puts the origin at the centre of
// the first pixel, so the formulas stand here once for all; the tests compare them with OpenCV's.
#include "host/data/lens.hpp"

#include <algorithm>
#include <cmath>

#include "host/base/error.hpp"

namespace ubs {
namespace {

// Half size of the ideal image in multiples of the distorted one: a fisheye of 180 degrees would need an
// infinite plane, and its border holds no detail worth the pixels.
constexpr double kMaxGrowth = 2.0;
constexpr int kBorderSamples = 64;

// theta / r, 1 at the centre.
double angle_ratio(double r) { return r > 1e-8 ? std::atan(r) / r : 1.0; }

std::array<double, 2> distort_opencv(const std::array<double, 12>& k, double x, double y) {
  const double r2 = x * x + y * y;
  const double radial =
      (1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))) / (1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7])));
  return {x * radial + 2 * k[2] * x * y + k[3] * (r2 + 2 * x * x),
          y * radial + 2 * k[3] * x * y + k[2] * (r2 + 2 * y * y)};
}

std::array<double, 2> distort_fisheye(const std::array<double, 12>& k, double x, double y) {
  const double r = std::hypot(x, y), theta = std::atan(r), t2 = theta * theta;
  const double ratio = angle_ratio(r) * (1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))));
  return {x * ratio, y * ratio};
}

std::array<double, 2> distort_fov(const std::array<double, 12>& k, double x, double y) {
  const double omega = k[0], r = std::hypot(x, y);
  if (std::abs(omega) < 1e-9) return {x, y};
  const double slope = 2 * std::tan(omega / 2);
  const double ratio = r > 1e-8 ? std::atan(r * slope) / (r * omega) : slope / omega;
  return {x * ratio, y * ratio};
}

std::array<double, 2> distort_thin_prism(const std::array<double, 12>& k, double x, double y) {
  const double ratio = angle_ratio(std::hypot(x, y)), u = x * ratio, v = y * ratio;
  const double r2 = u * u + v * v, radial = r2 * (k[0] + r2 * (k[1] + r2 * (k[4] + r2 * k[5])));
  return {u + u * radial + 2 * k[2] * u * v + k[3] * (r2 + 2 * u * u) + k[6] * r2,
          v + v * radial + 2 * k[3] * u * v + k[2] * (r2 + 2 * v * v) + k[7] * r2};
}

std::array<double, 2> distort_rad_tan_thin_prism(const std::array<double, 12>& k, double x, double y) {
  const double r = std::hypot(x, y), theta = std::atan(r), t2 = theta * theta;
  double radial = 0;
  for (int i = 5; i >= 0; --i) radial = t2 * (k[static_cast<std::size_t>(i)] + radial);
  const double ratio = angle_ratio(r) * (1 + radial), u = x * ratio, v = y * ratio, r2 = u * u + v * v;
  return {u + (2 * u * u + r2) * k[6] + 2 * u * v * k[7] + r2 * (k[8] + r2 * k[9]),
          v + (2 * v * v + r2) * k[7] + 2 * u * v * k[6] + r2 * (k[10] + r2 * k[11])};
}

// The ideal coordinate of a pixel position of the distorted image; the nearest limit where there is none.
std::array<double, 2> ideal_position(const Lens& lens, double u, double v,
                                     const std::array<double, 4>& limits) {
  double x = 0, y = 0;
  if (!undistort_point(lens, (u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy, x, y)) {
    x = u < lens.cx ? limits[0] : limits[1];
    y = v < lens.cy ? limits[2] : limits[3];
  }
  return {std::clamp(x, limits[0], limits[1]), std::clamp(y, limits[2], limits[3])};
}

// left, right, top, bottom of the inner rectangle.
std::array<double, 4> inner_rectangle(const Lens& lens, const std::array<double, 4>& limits) {
  std::array<double, 4> r = limits;
  for (int i = 0; i <= kBorderSamples; ++i) {
    const double u = static_cast<double>(lens.width) * i / kBorderSamples;
    const double v = static_cast<double>(lens.height) * i / kBorderSamples;
    r[0] = std::max(r[0], ideal_position(lens, 0, v, limits)[0]);
    r[1] = std::min(r[1], ideal_position(lens, lens.width, v, limits)[0]);
    r[2] = std::max(r[2], ideal_position(lens, u, 0, limits)[1]);
    r[3] = std::min(r[3], ideal_position(lens, u, lens.height, limits)[1]);
  }
  return r;
}

}  // namespace

bool Lens::distorted() const {
  if (model == LensModel::opencv_fisheye || model == LensModel::thin_prism_fisheye ||
      model == LensModel::rad_tan_thin_prism_fisheye)
    return true;  // equidistant even where all coefficients are zero
  return std::ranges::any_of(k, [](double v) { return v != 0; });
}

Lens Lens::scaled_to(int new_width, int new_height) const {
  Lens result = *this;
  const double sx = static_cast<double>(new_width) / width, sy = static_cast<double>(new_height) / height;
  result.fx *= sx, result.cx *= sx, result.fy *= sy, result.cy *= sy;
  result.width = new_width, result.height = new_height;
  return result;
}

std::array<double, 2> distort(const Lens& lens, double x, double y) {
  switch (lens.model) {
    case LensModel::opencv:
      return distort_opencv(lens.k, x, y);
    case LensModel::opencv_fisheye:
      return distort_fisheye(lens.k, x, y);
    case LensModel::fov:
      return distort_fov(lens.k, x, y);
    case LensModel::thin_prism_fisheye:
      return distort_thin_prism(lens.k, x, y);
    case LensModel::rad_tan_thin_prism_fisheye:
      return distort_rad_tan_thin_prism(lens.k, x, y);
  }
  return {x, y};
}

// Newton with a numerical Jacobian, steps halved while they do not help. A fold of the radial polynomial
// (negative determinant) would map two rays to one pixel; such a solution is refused.
bool undistort_point(const Lens& lens, double xd, double yd, double& x, double& y) {
  x = xd, y = yd;
  constexpr double kStep = 1e-6;
  auto residual = [&](double px, double py) {
    const auto d = distort(lens, px, py);
    return std::array<double, 2>{d[0] - xd, d[1] - yd};
  };
  auto r = residual(x, y);
  double det = 1;
  for (int iteration = 0; iteration < 60; ++iteration) {
    const auto rx1 = residual(x + kStep, y), rx0 = residual(x - kStep, y);
    const auto ry1 = residual(x, y + kStep), ry0 = residual(x, y - kStep);
    const double a = (rx1[0] - rx0[0]) / (2 * kStep), b = (ry1[0] - ry0[0]) / (2 * kStep);
    const double c = (rx1[1] - rx0[1]) / (2 * kStep), d = (ry1[1] - ry0[1]) / (2 * kStep);
    det = a * d - b * c;
    if (std::hypot(r[0], r[1]) < 1e-10) break;
    if (!(std::abs(det) > 1e-12)) return false;
    const double sx = (d * r[0] - b * r[1]) / det, sy = (a * r[1] - c * r[0]) / det;
    double factor = 1;
    std::array<double, 2> next{};
    for (; factor > 1e-4; factor /= 2) {
      next = residual(x - factor * sx, y - factor * sy);
      if (std::hypot(next[0], next[1]) < std::hypot(r[0], r[1])) break;
    }
    if (factor <= 1e-4) break;
    x -= factor * sx, y -= factor * sy, r = next;
  }
  return std::hypot(r[0], r[1]) < 1e-7 && det > 0 && std::isfinite(x) && std::isfinite(y);
}

Undistortion plan_undistortion(const Lens& lens, const std::string& where) {
  const std::array<double, 4> limits{-kMaxGrowth * std::max(lens.cx, 1.0) / lens.fx,
                                     kMaxGrowth * std::max(lens.width - lens.cx, 1.0) / lens.fx,
                                     -kMaxGrowth * std::max(lens.cy, 1.0) / lens.fy,
                                     kMaxGrowth * std::max(lens.height - lens.cy, 1.0) / lens.fy};
  const std::array<double, 4> r = inner_rectangle(lens, limits);
  Undistortion plan;
  plan.lens = lens;
  const double width = std::floor((r[1] - r[0]) * lens.fx + 1e-6),
               height = std::floor((r[3] - r[2]) * lens.fy + 1e-6);
  if (!(width >= 1 && height >= 1) || !(width < 65536 && height < 65536))
    fail(ErrorKind::data, "{}: the distortion parameters leave no usable image", where);
  plan.width = static_cast<int>(width);
  plan.height = static_cast<int>(height);
  plan.cx = -r[0] * lens.fx;
  plan.cy = -r[2] * lens.fy;
  return plan;
}

}  // namespace ubs
