// SPDX-License-Identifier: Apache-2.0
// What the cameras of a data set tell of its scene before anything is known of it: whether they look at one
// place, from how far, and where the first splats may lie when the data bring no points.
#pragma once

#include <optional>
#include <span>
#include <string>

#include "host/base/vector3.hpp"
#include "host/scene/camera.hpp"

namespace ubs {

// As nearest_to_axes (host/scene/pose.hpp), but none where the point lies behind half of the cameras.
inline constexpr double kConverging = 0.05;  // they look at it from many sides
std::optional<Vec3> meeting_point(std::span<const Camera> cameras, double least = kConverging);

// Either a cube (`half` > 0), or what the cameras see between two depths.
struct InitialSpace {
  Vec3 centre{0, 0, 0};
  double half = 0;
  double near = 0, far = 0;  // 0 < near < far
  double depth = 0;          // at which the cameras see its middle
  std::string text;          // in words, for the user
};

// Finite for every rig, also for one camera and for cameras that stand at one place. `nothing_behind`: the
// pictures show an object before a plain background, so that what all cameras see in common is all there is.
InitialSpace initial_space(std::span<const Camera> cameras, bool nothing_behind);

}  // namespace ubs
