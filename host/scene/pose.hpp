// SPDX-License-Identifier: Apache-2.0
// Pose describes the position, orientation, angle of view and time of a camera. Camera paths interpolate
// poses, and the viewer moves them. Axes are those of Camera (x right, y down, z forward).
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

  // These functions return the unit vectors of the camera axes in world coordinates.
  Vec3 right() const;
  Vec3 down() const;
  Vec3 forward() const;
};

// Interpolates between the rotations a (s = 0) and b (s = 1), on the shorter path and with constant angular
// speed.
Quaternion slerp(const Quaternion& a, const Quaternion& b, double s);
// Converts a row-major rotation matrix, such as Camera::rotation, to a quaternion.
Quaternion quaternion(const std::array<double, 9>& rotation);
// Returns the row-major rotation matrix of a unit quaternion.
std::array<double, 9> matrix(const Quaternion& q);

// Returns the pose at `position` that looks at `target` with `up` pointing upwards in the image. If `up` is
// (nearly) parallel to the view direction, or `target` equals `position`, another direction is used instead,
// so that the result is always a rotation.
Pose look_at(const Vec3& position, const Vec3& target, const Vec3& up);

// Canvas holds the properties of a camera that a pose does not contain.
struct Canvas {
  int width = 800, height = 600;
  std::vector<double> extra;  // further query values (Camera::extra)
};

// Returns a camera with square pixels and the principal point in the centre of the image.
Camera camera_at(const Pose& pose, const Canvas& canvas);
// Returns the pose of a camera. Its angle of view is computed from fx and the image width.
Pose pose_of(const Camera& camera);
// Returns the smallest horizontal angle of view [rad] at which an image of the size of `canvas` shows
// everything that the camera's image shows. If the aspect ratios differ, the image of this size also shows
// more.
double fov_showing(const Camera& camera, const Canvas& canvas);
// Returns the right (0), down (1) or forward (2) axis of the camera in world coordinates.
Vec3 camera_axis(const Camera& camera, std::size_t axis);
// Returns the unit vector towards the point that the centre of the image shows, in world coordinates. This is
// the forward axis, unless the principal point is not in the centre.
Vec3 view_direction(const Camera& camera);
// Returns the point with the smallest sum of squared distances from the view axes of all cameras, or nothing
// if the axes are nearly parallel. `least` is the minimum for the determinant of the mean of I - d d^T over
// the view directions d. The determinant is 0 if all directions are parallel, and 8/27 if they are
// distributed evenly over the sphere.
std::optional<Vec3> nearest_to_axes(std::span<const Camera> cameras, double least);
// Returns the median of `value` over at least one camera.
double median(std::span<const Camera> cameras, const std::function<double(const Camera&)>& value);

}  // namespace ubs
