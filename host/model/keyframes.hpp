// SPDX-License-Identifier: Apache-2.0
// read_keyframes() reads camera keyframes from a JSON file that users write (docs/view.md):
//   {"closed": false, "keyframes": [{"position": [x, y, z], "look_at": [x, y, z], "up": [x, y, z],
//                                    "fov": degrees, "time": t}, ...]}
// Instead of position, look_at and up, a keyframe may have a matrix: either "world_to_camera" (3x4 or 4x4,
// with the axes of COLMAP and OpenCV: x right, y down, z forward), or "transform_matrix" (camera to world,
// with the axes of transforms.json: x right, y up, z backward).
// It also reads the camera paths of nerfstudio (camera_path.json), the cameras of 3DGS (cameras.json) and the
// settings of SuperSplat's viewer (settings.json). These files are converted to keyframes.
#pragma once

#include <filesystem>
#include <vector>

#include "host/scene/pose.hpp"

namespace ubs {

struct KeyframeFile {
  std::vector<Pose> poses;
  bool closed = false, has_time = false;
};

// Values for fields that a keyframe does not have, and the origin of the model's coordinates.
struct KeyframeDefaults {
  Vec3 up{0, 0, 1};
  double fov = 0.87;  // horizontal angle of view [rad]
  // A position in the world is the position in the model plus this offset. The file contains world
  // coordinates, and the returned poses have model coordinates.
  Vec3 offset{0, 0, 0};
};

// Reads a file of keyframes. Throws Error(data) if the file is not valid; the message contains the file, the
// keyframe and the field.
KeyframeFile read_keyframes(const std::filesystem::path& path, const KeyframeDefaults& defaults);

}  // namespace ubs
