// SPDX-License-Identifier: Apache-2.0
// read_keyframes() reads camera keyframes from a JSON file that users write (docs/view.md):
//   {"closed": false, "keyframes": [{"position": [x, y, z], "look_at": [x, y, z], "up": [x, y, z],
//                                    "fov": degrees, "time": t}, ...]}
// Instead of position, look_at and up a keyframe may have "world_to_camera" (3x4 or 4x4, axes of COLMAP and
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
  double fov = 0.87;  // horizontal [rad]
  // Position in the world = position in the model + offset. The file has world coordinates; the returned
  // poses are in model coordinates.
  Vec3 offset{0, 0, 0};
};

// Throws Error(data) that names file, keyframe and field.
KeyframeFile read_keyframes(const std::filesystem::path& path, const KeyframeDefaults& defaults);

}  // namespace ubs
