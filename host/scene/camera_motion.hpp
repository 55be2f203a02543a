// SPDX-License-Identifier: Apache-2.0
// CameraMove describes a small motion of a camera. Camera refinement (method.md 4.10) and pose fitting
// optimise these motions. fix_similarity() removes the common rotation, translation and scaling of all
// cameras, which cannot be determined from images.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "host/base/vector3.hpp"
#include "host/scene/camera.hpp"

namespace ubs {

// Returns the rotation about the axis `turn` by the angle |turn| in radians, exp([turn]).
RotationMatrix rotation_by(const Vec3& turn);
// Returns the inverse of rotation_by(), for rotations by less than pi.
Vec3 turn_of(const RotationMatrix& rotation);

// A CameraMove consists of ten numbers. They are scaled so that a value of x moves the image content by
// roughly x radians. Numbers 0 to 2 are a rotation of the camera about its pivot, in radians. The pivot is
// the point on the optical axis at the distance `depth`. It is used because the effect of a rotation about
// the camera's own centre on the image is hard to distinguish from that of a translation. Numbers 3 to 5 are
// a translation of the pivot, in units of `depth`. Numbers 6 and 7 are the logarithms of the factors by which
// the focal lengths change. Numbers 8 and 9 shift the principal point, in units of the focal lengths. The
// first kPoseMoves numbers change the pose, and the others change the lens.
inline constexpr std::size_t kPoseMoves = 6, kCameraMoves = 10;
using CameraMove = std::array<double, kCameraMoves>;
// Returns `camera` after the motion.
Camera moved(const Camera& camera, const CameraMove& move, double depth);
// Returns the motion that changes the pose of `from` to that of `to`. Its numbers 6 to 9, which change the
// lens, are 0.
CameraMove pose_move(const Camera& from, const Camera& to, double depth);

// Applies one common motion to cameras that have the same position, and returns the result. The motion is a
// rotation about this position and a translation. It is the mean of the motions that change each given camera
// to the corresponding camera of `moved`. This is used for the views of a wide image, which must stay at the
// same position.
std::vector<Camera> moved_together(std::span<const Camera> given, std::span<const Camera> moved);

// If the scene and all cameras are rotated, translated and scaled together, no image changes. This common
// transformation can therefore be chosen freely. fix_similarity() transforms all cameras so that their mean
// rotation relative to the given cameras is 0. The mean of their centres, and the mean squared distance of
// the centres from this mean, are then the same as for the given cameras. If the cameras have the same
// position, their distances are not scaled.
void fix_similarity(std::vector<Camera>& cameras, std::span<const Camera> given);

}  // namespace ubs
