// SPDX-License-Identifier: Apache-2.0
// What a camera path or a viewer needs to know of a scene before anybody has looked at it: where its middle
// is, which way is up, from how far to look. From the cameras of its data where there are any, else from the
// splats alone. Stray splats and cameras do not move the result far: medians throughout.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "host/scene/mixed_model.hpp"
#include "host/scene/pose.hpp"

namespace ubs {

struct SceneFrame {
  Vec3 centre{0, 0, 0};
  Vec3 up{0, 0, 1};           // unit length
  double size = 1;            // half of the splats by opacity are nearer to the centre, > 0
  double distance = 4;        // of a camera from the centre, > 0
  double elevation = 0;       // of a camera above the plane through the centre [rad]
  Vec3 start{1, 0, 0};        // direction in that plane from the centre to the first camera, unit length
  Pose mean;                  // the mean of the cameras, for paths of forward-facing scenes
  double focus = 4;           // depth at which that pose finds the scene, > 0
  double spread = 0.5;        // how far the cameras lie around the mean pose: a radius, > 0
  bool around = false;        // the cameras look at one point from many sides
  std::vector<double> extra;  // query values after time, when no camera states them
};

// What the user knows better; anything unset is estimated.
struct FrameHints {
  std::optional<Vec3> centre, up;
  std::optional<double> distance, elevation;  // [scene units], [rad]
  Vec3 up_without_floor{0, 0, 1};  // upwards where neither cameras nor a floor among the splats tell
  std::optional<double> fov;       // the smaller angle of the pictures to come [rad]; 0.87 (50 degrees)
};

// `cameras` may be empty: then up is the axis that points away from a floor (a quarter of the opacity in a
// layer at most a third as thick as that of the quarter at the other end), and centre and distance are such
// that 99.5 % of the opacity near the middle is in the picture from all around; far strays and surroundings
// are not looked at. Throws Error(data) when there are neither cameras nor splats to go by.
SceneFrame scene_frame(const MixedModel& model, std::span<const Camera> cameras,
                       const FrameHints& hints = {});

// Cameras that a model notes, which say their times alone: with values of the other queries that are typical
// of its splats.
std::vector<Camera> noted_cameras(const MixedModel& model, std::vector<Camera> cameras);

// At the start of an orbit, looking at the centre.
Pose orbit_start(const SceneFrame& frame);

// The smallest value such that values up to it have at least the share q (0 to 1) of the weight; weights are
// not negative. 0 without weight.
double weighted_quantile(std::vector<std::pair<double, double>> value_weight, double q);

}  // namespace ubs
