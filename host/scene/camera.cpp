// SPDX-License-Identifier: Apache-2.0
#include "host/scene/camera.hpp"

#include <algorithm>
#include <cmath>

#include "host/base/error.hpp"

namespace ubs {
namespace {

// The largest deviation from a rotation in the published data sets is 1.4e-6. A scaled or sheared matrix is
// an error that would silently distort the geometry.
constexpr double kRotationTolerance = 1e-3;
// If the elements of a rotation are rounded to three decimal places, the determinant deviates from 1 by at
// most 5e-4 times 3 sqrt(3), which is 2.6e-3.
constexpr double kRoundedTolerance = 5e-3;

struct RotationFit {
  double determinant = 0;
  double worst = 0;  // largest deviation of the scalar products of two rows from those of a rotation
  // The comparisons are false for NaN, so NaN is rejected.
  bool within(double tolerance) const {
    return std::abs(determinant - 1.0) <= tolerance && worst <= tolerance;
  }
};

RotationFit rotation_fit(const std::array<double, 9>& m) {
  RotationFit fit;
  for (std::size_t a = 0; a < 3; ++a)
    for (std::size_t b = a; b < 3; ++b) {
      const double dot = m[3 * a] * m[3 * b] + m[3 * a + 1] * m[3 * b + 1] + m[3 * a + 2] * m[3 * b + 2];
      fit.worst = std::max(fit.worst, std::abs(dot - (a == b ? 1.0 : 0.0)));
    }
  fit.determinant = m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) +
                    m[2] * (m[3] * m[7] - m[4] * m[6]);
  return fit;
}

}  // namespace

std::array<double, 3> Camera::centre() const {
  std::array<double, 3> c{};
  for (int row = 0; row < 3; ++row)
    for (int col = 0; col < 3; ++col) c[col] -= rotation[3 * row + col] * translation[row];
  return c;
}

std::array<double, 3> Camera::ray(double column, double row) const {
  const double local[3] = {(column - cx) / fx, (row - cy) / fy, 1};
  std::array<double, 3> out{};
  for (std::size_t k = 0; k < 3; ++k)
    for (std::size_t r = 0; r < 3; ++r) out[k] += rotation[3 * r + k] * local[r];
  return out;
}

// The Newton-Schulz iteration M <- (3 M - M M^T M) / 2 converges to the nearest orthogonal matrix. It squares
// the deviation, so four steps reduce it from 5e-3 to rounding errors.
bool settle_rotation(std::array<double, 9>& m) {
  // The deviations of rows and columns differ, and check_rotation() may be called for the transpose later.
  const RotationFit rows = rotation_fit(m),
                    columns = rotation_fit({m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]});
  const auto within = [&](double tolerance) { return rows.within(tolerance) && columns.within(tolerance); };
  if (within(kRotationTolerance) || !within(kRoundedTolerance)) return false;
  for (int step = 0; step < 4; ++step) {
    const std::array<double, 9> old = m;
    for (std::size_t r = 0; r < 3; ++r) {
      std::array<double, 3> products{};  // row r of M M^T
      for (std::size_t k = 0; k < 3; ++k)
        for (std::size_t c = 0; c < 3; ++c) products[k] += old[3 * r + c] * old[3 * k + c];
      for (std::size_t c = 0; c < 3; ++c) {
        double cubic = 0;
        for (std::size_t k = 0; k < 3; ++k) cubic += products[k] * old[3 * k + c];
        m[3 * r + c] = 1.5 * old[3 * r + c] - 0.5 * cubic;
      }
    }
  }
  return true;
}

void check_rotation(const std::array<double, 9>& m, const std::string& what) {
  const RotationFit fit = rotation_fit(m);
  if (!fit.within(kRotationTolerance))
    fail(
        ErrorKind::data,
        "{} is not a rotation (determinant {:.4g}, deviation from orthogonality {:.2g}): remove scale, shear "
        "or mirroring",
        what, fit.determinant, fit.worst);
}

std::vector<Camera> evenly_chosen(std::span<const Camera> cameras, std::size_t most) {
  std::vector<Camera> chosen;
  const std::size_t count = std::min(most, cameras.size());
  for (std::size_t i = 0; i < count; ++i) chosen.push_back(cameras[i * cameras.size() / count]);
  return chosen;
}

double checked_input(double value, const std::string& what) {
  if (!std::isfinite(value)) fail(ErrorKind::data, "{} is not finite", what);
  if (std::abs(value) > kMaxMagnitude)
    fail(ErrorKind::data, "{} = {:g} exceeds the maximum of {:g}", what, value, kMaxMagnitude);
  return value;
}

void check_camera(const Camera& camera, const std::string& where) {
  check_rotation(camera.rotation, where + ": the orientation of the camera");
  const auto check = [&](const char* what, double value) { checked_input(value, where + ": " + what); };
  for (const double t : camera.translation) check("the position of the camera", t);
  for (const double f : {camera.fx, camera.fy}) {
    check("the focal length", f);
    if (!(f >= kMinFocal))
      fail(ErrorKind::data, "{}: the focal length {:g} must be at least {:g} pixels", where, f, kMinFocal);
  }
  for (const double c : {camera.cx, camera.cy}) check("the principal point", c);
  if (std::min(camera.width, camera.height) < 1 || std::max(camera.width, camera.height) > kMaxPixelsAcross ||
      std::int64_t{camera.width} * camera.height > kMaxPixels)
    fail(ErrorKind::data,
         "{}: the image size {}x{} is not possible: width and height must be 1 to {}, and an image can have "
         "at most {} pixels",
         where, camera.width, camera.height, kMaxPixelsAcross, kMaxPixels);
  check("the time", camera.time);
  for (const double q : camera.extra) check("a query value", q);
}

}  // namespace ubs
