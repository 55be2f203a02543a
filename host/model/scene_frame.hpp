// SPDX-License-Identifier: Apache-2.0
// SceneFrame describes a scene for camera paths and viewers: its centre, its up direction, and the distance
// to look from. It is estimated from the cameras of the data if there are any, otherwise from the splats
// alone. Stray splats and cameras have little influence, because most estimates are medians or other
// quantiles.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "host/scene/mixed_model.hpp"
#include "host/scene/pose.hpp"

namespace ubs {

struct SceneFrame {
  Vec3 centre{0, 0, 0};
  Vec3 up{0, 0, 1};      // unit length
  double size = 1;       // median distance of the splats from the centre, weighted by opacity, > 0
  double distance = 4;   // distance of an orbiting camera from the centre, > 0
  double elevation = 0;  // elevation of an orbiting camera above the plane through the centre [rad]
  Vec3 start{1, 0, 0};   // direction in this plane from the centre to the first camera, unit length
  Pose mean;             // mean pose of the cameras, for camera paths in forward-facing scenes
  double focus = 4;      // depth of the scene as seen from the mean pose, > 0
  double spread = 0.5;   // radius around the mean pose within which most cameras are, > 0
  // True if the cameras look at one point from all sides, so that an orbit only shows sides that the cameras
  // have seen.
  bool around = false;
  std::vector<double> extra;  // values of the query dimensions after time, for cameras without these values
};

// FrameHints holds values that the user sets. Values that are not set are estimated.
struct FrameHints {
  std::optional<Vec3> centre, up;
  std::optional<double> distance, elevation;  // in units of the scene, and in radians
  // Up direction that is used if there are no cameras and the splats contain no floor.
  Vec3 up_without_floor{0, 0, 1};
  // The smaller of the horizontal and vertical angle of view of the images to render [rad]. If it is not set,
  // 0.87 (50 degrees) is used.
  std::optional<double> fov;
};

// Estimates the frame of a scene. If `cameras` is empty, it is estimated from the splats, as follows. The up
// direction is the coordinate axis that points away from a floor. Along each axis, the function compares two
// layers at the ends of the scene, each with a quarter of the opacity; the thinner one is a floor if its
// thickness is at most a third of that of the other. Centre and distance are chosen so that images from all
// sides show 99.5 % of the opacity, without distant stray splats and surroundings. Throws Error(data) if
// there are neither cameras nor splats.
SceneFrame scene_frame(const MixedModel& model, std::span<const Camera> cameras,
                       const FrameHints& hints = {});

// Completes the cameras of a model file. The file stores only the times of its cameras, so this function sets
// their other query values to values that are typical of the splats of the model.
std::vector<Camera> noted_cameras(const MixedModel& model, std::vector<Camera> cameras);

// Returns the index of the camera that a viewer should start with. It is the first camera that sees the
// largest share of the subject, or a share that is smaller by at most 0.02. The subject consists of the
// splats within a ball around the point that the cameras look at, or of all splats if there is no such point.
// Splats are weighted by opacity.
// `cameras` must not be empty.
std::size_t start_camera(const MixedModel& model, std::span<const Camera> cameras);

// Returns the pose at the start of an orbit, looking at the centre.
Pose orbit_start(const SceneFrame& frame);

// Returns the smallest value v for which the values that are at most v have at least the share q (0 to 1) of
// the total weight. Values that are not finite or whose weight is not positive are ignored. Returns 0 if no
// values remain.
double weighted_quantile(std::vector<std::pair<double, double>> value_weight, double q);

}  // namespace ubs
