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

void check_rotation(const std::array<double, 9>& m, const std::string& what) {
  double worst = 0;
  for (std::size_t a = 0; a < 3; ++a)
    for (std::size_t b = a; b < 3; ++b) {
      const double dot = m[3 * a] * m[3 * b] + m[3 * a + 1] * m[3 * b + 1] + m[3 * a + 2] * m[3 * b + 2];
      worst = std::max(worst, std::abs(dot - (a == b ? 1.0 : 0.0)));
    }
  const double det = m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) +
                     m[2] * (m[3] * m[7] - m[4] * m[6]);
  // The condition is negated, so that NaN is rejected.
  if (!(std::abs(det - 1.0) <= kRotationTolerance && worst <= kRotationTolerance))
    fail(
        ErrorKind::data,
        "{} is not a rotation (determinant {:.4g}, deviation from orthogonality {:.2g}): remove scale, shear "
        "or mirroring",
        what, det, worst);
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
    fail(ErrorKind::data, "{}: the image size {}x{} is not possible", where, camera.width, camera.height);
  check("the time", camera.time);
  for (const double q : camera.extra) check("a query value", q);
}

}  // namespace ubs
