// SPDX-License-Identifier: Apache-2.0
// Camera keyframes as a JSON file, written by people (docs/view.md):
//   {"closed": false, "keyframes": [{"position": [x, y, z], "look_at": [x, y, z], "up": [x, y, z],
//                                    "fov": degrees, "time": t}, ...]}
// In the place of position, look_at and up a frame may have "world_to_camera" (3x4 or 4x4, axes of COLMAP and
// OpenCV: x right, y down, z forward) or "transform_matrix" (camera to world, axes of transforms.json).
#pragma once

#include <filesystem>
#include <vector>

#include "host/scene/pose.hpp"

namespace ubs {

struct KeyframeFile {
  std::vector<Pose> poses;
  bool closed = false, has_time = false;
};

struct KeyframeDefaults {
  Vec3 up{0, 0, 1};
  double fov = 0.87;     // horizontal [rad]
  Vec3 offset{0, 0, 0};  // world = model + offset: the file is in the world, poses are in the model
};

// Throws Error(data) naming file, keyframe and field.
KeyframeFile read_keyframes(const std::filesystem::path& path, const KeyframeDefaults& defaults);

}  // namespace ubs
