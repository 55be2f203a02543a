// SPDX-License-Identifier: Apache-2.0
// Where a camera is, where it looks, how wide and at what time: what camera paths interpolate and the viewer
// moves. Axes are those of Camera (x right, y down, z forward).
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "host/base/vector3.hpp"
#include "host/scene/camera.hpp"

namespace ubs {

struct Quaternion {
  double w = 1, x = 0, y = 0, z = 0;
};

struct Pose {
  Vec3 position{0, 0, 0};
  Quaternion rotation;  // world -> camera, unit length
  double fov = 0.87;    // horizontal angle of view [rad], inside (0, pi)
  double time = 0;

  // Unit vectors of the camera in the world.
  Vec3 right() const;
  Vec3 down() const;
  Vec3 forward() const;
};

// The shorter way from a (s = 0) to b (s = 1) at constant speed.
Quaternion slerp(const Quaternion& a, const Quaternion& b, double s);
// From a rotation with row-major entries, as Camera::rotation.
Quaternion quaternion(const std::array<double, 9>& rotation);
std::array<double, 9> matrix(const Quaternion& q);

// At `position`, looking at `target` with `up` upwards in the picture. Where up is (nearly) along the view,
// or target is at the position, some other direction takes its place: the result is always a rotation.
Pose look_at(const Vec3& position, const Vec3& target, const Vec3& up);

// What a pose does not say of a camera.
struct Canvas {
  int width = 800, height = 600;
  std::vector<double> extra;  // further query values (Camera::extra)
};

// Square pixels, principal point in the middle.
Camera camera_at(const Pose& pose, const Canvas& canvas);
Pose pose_of(const Camera& camera);
// The horizontal angle of view [rad] at which a picture of the canvas shows all that the camera's does, and
// more where the shapes differ.
double fov_showing(const Camera& camera, const Canvas& canvas);
// Right (0), down (1) or forward (2) in the world.
Vec3 camera_axis(const Camera& camera, std::size_t axis);
// Unit vector towards what the middle of the image shows, in the world: forward, unless the principal point
// is elsewhere.
Vec3 view_direction(const Camera& camera);
// The point nearest to all view directions (least squares). None where these are too parallel to tell:
// `least` is the smallest determinant of the mean of I - d d^T over the viewing directions d. That is 0 when
// all are parallel, 8/27 when they come from everywhere.
std::optional<Vec3> nearest_to_axes(std::span<const Camera> cameras, double least);
// Of at least one camera.
double median(std::span<const Camera> cameras, const std::function<double(const Camera&)>& value);

}  // namespace ubs
