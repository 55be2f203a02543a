// SPDX-License-Identifier: Apache-2.0
// SceneFrame describes a scene for camera paths and viewers: its centre, its up direction, and the distance
// to look from. It is estimated from the cameras of the data if there are any, otherwise from the splats
// alone. Stray splats and cameras have little influence, because all estimates are medians.
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
  double size = 1;            // median distance of the splats from the centre, weighted by opacity, > 0
  double distance = 4;        // of a camera from the centre, > 0
  double elevation = 0;       // of a camera above the plane through the centre [rad]
  Vec3 start{1, 0, 0};        // direction in that plane from the centre to the first camera, unit length
  Pose mean;                  // the mean of the cameras, for paths of forward-facing scenes
  double focus = 4;           // depth of the scene as seen from that pose, > 0
  double spread = 0.5;        // radius within which the cameras are around the mean pose, > 0
  bool around = false;        // the cameras look at one point from all sides: an orbit sees what they saw
  std::vector<double> extra;  // values of the queries after time, for cameras that do not state them
};

// Values that the user states; unset ones are estimated.
struct FrameHints {
  std::optional<Vec3> centre, up;
  std::optional<double> distance, elevation;  // [scene units], [rad]
  Vec3 up_without_floor{0, 0, 1};  // used if neither cameras nor a floor among the splats determine it
  std::optional<double> fov;       // smaller angle of view of the images to render [rad]; 0.87 (50 degrees)
};

// `cameras` may be empty. Then up is the axis that points away from a floor: a quarter of the opacity is in a
// layer at most a third as thick as the layer with the quarter at the other end. Centre and distance are
// chosen so that images from all sides show 99.5 % of the opacity near the middle; distant stray splats and
// surroundings are ignored. Throws Error(data) if there are neither cameras nor splats.
SceneFrame scene_frame(const MixedModel& model, std::span<const Camera> cameras,
                       const FrameHints& hints = {});

// Completes the cameras that a model file lists, which state only their times: sets the other query values to
// values that are typical of the model's splats.
std::vector<Camera> noted_cameras(const MixedModel& model, std::vector<Camera> cameras);

// Returns the index of the camera that a viewer should start with: the first one that sees as much of the
// subject as any other camera, or almost as much. The subject consists of the splats within a ball around the
// point that the cameras look at, or of all splats if there is no such point. Splats are weighted by opacity.
// `cameras` must not be empty.
std::size_t start_camera(const MixedModel& model, std::span<const Camera> cameras);

// Returns the pose at the start of an orbit, looking at the centre.
Pose orbit_start(const SceneFrame& frame);

// Returns the smallest value for which all values up to it have at least the share q (0 to 1) of the total
// weight. Weights must not be negative. Returns 0 if there is no weight.
double weighted_quantile(std::vector<std::pair<double, double>> value_weight, double q);

}  // namespace ubs
