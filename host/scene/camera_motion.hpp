// SPDX-License-Identifier: Apache-2.0
// Small moves of cameras: what refining them (method.md 4.10) and fitting a pose change, and the gauge that
// no picture determines.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "host/base/vector3.hpp"
#include "host/scene/camera.hpp"

namespace ubs {

RotationMatrix rotation_by(const Vec3& turn);  // exp([turn])
Vec3 turn_of(const RotationMatrix& rotation);  // its logarithm, for turns below pi

// Ten angles, in radians as seen in the picture. 0 to 2 turn the camera about its pivot, the point at `depth`
// on its axis, 3 to 5 shift the pivot by that many depths: about its own centre a turn looks much like a
// shift. 6 and 7 are logarithms of the focal lengths, 8 and 9 shift the principal point by that many focal
// lengths.
inline constexpr std::size_t kPoseMoves = 6, kCameraMoves = 10;
using CameraMove = std::array<double, kCameraMoves>;
Camera moved(const Camera& camera, const CameraMove& move, double depth);
// What moves the pose of one to that of the other; the lens' part is 0.
CameraMove pose_move(const Camera& from, const Camera& to, double depth);

// A turn, shift and scale of the whole world changes no picture. It is chosen so that the mean turn of the
// cameras from those given, their mean centre and their mean squared distance from it are those given.
void hold_gauge(std::vector<Camera>& cameras, std::span<const Camera> given);

}  // namespace ubs
