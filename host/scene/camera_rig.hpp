// SPDX-License-Identifier: Apache-2.0
// initial_space() estimates where a scene is, using only the cameras of its data set. It finds out whether
// the cameras look at one point and from which distance, and returns the space for the initial splats of data
// sets without points.
#pragma once

#include <optional>
#include <span>
#include <string>

#include "host/base/vector3.hpp"
#include "host/scene/camera.hpp"

namespace ubs {

// Minimum determinant (see nearest_to_axes in host/scene/pose.hpp) of cameras that look at one point from
// many sides.
inline constexpr double kConverging = 0.05;
// Returns the point that is nearest to the view axes of all cameras. Returns nothing if the determinant is
// smaller than `least`, which means that the axes are too parallel, or if the point is behind at least half
// of the cameras.
std::optional<Vec3> meeting_point(std::span<const Camera> cameras, double least = kConverging);

// An InitialSpace is either a cube, or the space that the cameras see between two depths. It is a cube if
// `half` > 0.
struct InitialSpace {
  Vec3 centre{0, 0, 0};      // centre of the cube
  double half = 0;           // half the side of the cube
  double near = 0, far = 0;  // the two depths, if this is not a cube: 0 < near < far
  double depth = 0;          // depth at which the cameras see the middle of the space
  std::string text;          // description for the user
};

// Returns the space for the initial splats. All its values are finite, even for a single camera or for
// cameras at one position. Pass `nothing_behind` if the images show an object in front of a plain background,
// so that the scene is limited to the space that all cameras see.
InitialSpace initial_space(std::span<const Camera> cameras, bool nothing_behind);

}  // namespace ubs
