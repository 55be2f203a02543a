// SPDX-License-Identifier: Apache-2.0
// CameraMove describes a small motion of a camera. Camera refinement (method.md 4.10) and pose fitting
// optimise these motions. hold_gauge() removes the common rotation, shift and scaling of all cameras, which
// no image determines.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "host/base/vector3.hpp"
#include "host/scene/camera.hpp"

namespace ubs {

RotationMatrix rotation_by(const Vec3& turn);  // returns exp([turn])
Vec3 turn_of(const RotationMatrix& rotation);  // returns the logarithm, for rotations by less than pi

// Ten numbers, in radians as seen in the image. 0 to 2 rotate the camera about its pivot, which is the point
// at `depth` on its axis. 3 to 5 shift the pivot, in units of that depth. A pivot is used because a rotation
// about the camera's own centre looks much like a shift. 6 and 7 are logarithms of the focal lengths. 8 and 9
// shift the principal point, in units of the focal lengths.
inline constexpr std::size_t kPoseMoves = 6, kCameraMoves = 10;
using CameraMove = std::array<double, kCameraMoves>;
Camera moved(const Camera& camera, const CameraMove& move, double depth);
// Returns the motion from the pose of `from` to that of `to`. The numbers of the lens are 0.
CameraMove pose_move(const Camera& from, const Camera& to, double depth);

// Returns the given cameras, which have the same position, after one rotation about it and one shift. Both
// are the mean of those that lead from the given cameras to `moved`. Used for the views of a wide image.
std::vector<Camera> moved_together(std::span<const Camera> given, std::span<const Camera> moved);

// A rotation, shift and scaling of the whole world changes no image, so it can be chosen freely. This
// function transforms all cameras together so that their mean rotation relative to the given cameras is 0,
// and their mean centre and mean squared distance from it are those of the given cameras.
void hold_gauge(std::vector<Camera>& cameras, std::span<const Camera> given);

}  // namespace ubs
