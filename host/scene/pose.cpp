// SPDX-License-Identifier: Apache-2.0
#include "host/scene/pose.hpp"

#include <utility>

#include "host/base/median.hpp"

namespace ubs {
namespace {

Quaternion unit(const Quaternion& q) {
  const double l = std::sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
  return {q.w / l, q.x / l, q.y / l, q.z / l};
}

double determinant(const Vec3& a, const Vec3& b, const Vec3& c) { return dot(a, cross(b, c)); }

}  // namespace

Vec3 Pose::right() const {
  const auto m = matrix(rotation);
  return {m[0], m[1], m[2]};
}
Vec3 Pose::down() const {
  const auto m = matrix(rotation);
  return {m[3], m[4], m[5]};
}
Vec3 Pose::forward() const {
  const auto m = matrix(rotation);
  return {m[6], m[7], m[8]};
}

Quaternion slerp(const Quaternion& a, const Quaternion& b, double s) {
  double cosine = a.w * b.w + a.x * b.x + a.y * b.y + a.z * b.z;
  const double sign = cosine < 0 ? -1 : 1;  // q and -q are the same rotation
  cosine = std::min(1.0, std::abs(cosine));
  double from = 1 - s, to = s;
  // Linear interpolation is used if the angle is very small. It is then accurate enough, whereas a division
  // by sin(angle) would be inaccurate.
  if (cosine < 1 - 1e-9) {
    const double angle = std::acos(cosine);
    from = std::sin((1 - s) * angle) / std::sin(angle);
    to = std::sin(s * angle) / std::sin(angle);
  }
  to *= sign;
  return unit({from * a.w + to * b.w, from * a.x + to * b.x, from * a.y + to * b.y, from * a.z + to * b.z});
}

// Let c be the component of the quaternion q with the largest magnitude. Each branch computes the product 4 c
// q, and unit() removes the factor 4 c. The component 4 c^2 of the product is computed from the diagonal of
// the matrix. Choosing the largest component avoids cancellation.
Quaternion quaternion(const std::array<double, 9>& m) {
  const double w = 1 + m[0] + m[4] + m[8], x = 1 + m[0] - m[4] - m[8], y = 1 - m[0] + m[4] - m[8],
               z = 1 - m[0] - m[4] + m[8];  // four times the squares of the components
  const double largest = std::max({w, x, y, z});
  if (largest == w) return unit({w, m[7] - m[5], m[2] - m[6], m[3] - m[1]});
  if (largest == x) return unit({m[7] - m[5], x, m[3] + m[1], m[2] + m[6]});
  if (largest == y) return unit({m[2] - m[6], m[3] + m[1], y, m[7] + m[5]});
  return unit({m[3] - m[1], m[2] + m[6], m[7] + m[5], z});
}

std::array<double, 9> matrix(const Quaternion& q) {
  const double w = q.w, x = q.x, y = q.y, z = q.z;
  return {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
          2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
          2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
}

Pose look_at(const Vec3& position, const Vec3& target, const Vec3& up) {
  const Vec3 forward = normalised(target - position);
  const Vec3 right = normalised(cross(forward, normalised(up)), perpendicular(forward));
  const Vec3 down = cross(forward, right);
  Pose pose;
  pose.position = position;
  pose.rotation = quaternion(
      {right[0], right[1], right[2], down[0], down[1], down[2], forward[0], forward[1], forward[2]});
  return pose;
}

Camera camera_at(const Pose& pose, const Canvas& canvas) {
  Camera camera;
  camera.rotation = matrix(pose.rotation);
  for (std::size_t r = 0; r < 3; ++r)
    for (std::size_t c = 0; c < 3; ++c)
      camera.translation[r] -= camera.rotation[3 * r + c] * pose.position[c];
  camera.width = canvas.width;
  camera.height = canvas.height;
  camera.fx = camera.fy = canvas.width / (2 * std::tan(pose.fov / 2));
  camera.cx = canvas.width / 2.0;
  camera.cy = canvas.height / 2.0;
  camera.time = pose.time;
  camera.extra = canvas.extra;
  return camera;
}

Pose pose_of(const Camera& camera) {
  Pose pose;
  pose.position = camera.centre();
  pose.rotation = quaternion(camera.rotation);
  pose.fov = 2 * std::atan(camera.width / (2 * camera.fx));
  pose.time = camera.time;
  return pose;
}

double fov_showing(const Camera& camera, const Canvas& canvas) {
  const double wide = 0.5 * camera.width / camera.fx, high = 0.5 * camera.height / camera.fy;
  return 2 * std::atan(std::max(wide, high * canvas.width / canvas.height));
}

Vec3 camera_axis(const Camera& camera, std::size_t axis) {
  return {camera.rotation[3 * axis], camera.rotation[3 * axis + 1], camera.rotation[3 * axis + 2]};
}

Vec3 view_direction(const Camera& camera) {
  return normalised(camera.ray(0.5 * camera.width, 0.5 * camera.height));
}

// Solves the normal equations with Cramer's rule. The matrix is symmetric, so a[i] is both its row i and its
// column i.
std::optional<Vec3> nearest_to_axes(std::span<const Camera> cameras, double least) {
  std::array<Vec3, 3> a{};
  Vec3 b{};
  const double n = static_cast<double>(cameras.size());
  for (const Camera& camera : cameras) {
    const Vec3 d = view_direction(camera), o = camera.centre();
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t k = 0; k < 3; ++k) {
        const double entry = ((i == k ? 1.0 : 0.0) - d[i] * d[k]) / n;
        a[i][k] += entry;
        b[i] += entry * o[k];
      }
    }
  }
  const double det = determinant(a[0], a[1], a[2]);
  if (!(det > least)) return std::nullopt;
  return Vec3{determinant(b, a[1], a[2]) / det, determinant(a[0], b, a[2]) / det,
              determinant(a[0], a[1], b) / det};
}

double median(std::span<const Camera> cameras, const std::function<double(const Camera&)>& value) {
  std::vector<double> values;
  for (const Camera& c : cameras) values.push_back(value(c));
  return median(std::move(values));
}

}  // namespace ubs
