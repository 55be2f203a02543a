// SPDX-License-Identifier: Apache-2.0
// initial_space() estimates where a scene is from the cameras of its data set alone: whether they look at one
// point, from which distance, and where to place the initial splats if the data have no points.
#pragma once

#include <optional>
#include <span>
#include <string>

#include "host/base/vector3.hpp"
#include "host/scene/camera.hpp"

namespace ubs {

// Like nearest_to_axes (host/scene/pose.hpp), but returns nothing if the point is behind at least half of the
// cameras.
inline constexpr double kConverging = 0.05;  // the cameras look at the point from many sides
std::optional<Vec3> meeting_point(std::span<const Camera> cameras, double least = kConverging);

// Either a cube (`half` > 0), or the space that the cameras see between two depths.
struct InitialSpace {
  Vec3 centre{0, 0, 0};
  double half = 0;
  double near = 0, far = 0;  // 0 < near < far
  double depth = 0;          // depth at which the cameras see the middle of the space
  std::string text;          // description for the user
};

// All values are finite, even for a single camera or for cameras at one position. `nothing_behind`: the
// images show an object in front of a plain background, so the scene is limited to the space that all cameras
// see.
InitialSpace initial_space(std::span<const Camera> cameras, bool nothing_behind);

}  // namespace ubs
