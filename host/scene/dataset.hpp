// SPDX-License-Identifier: Apache-2.0
// What a loader delivers and everything downstream consumes: named views with cameras and,
// where the files exist, 8-bit images already composited on the background.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "host/scene/camera.hpp"

namespace ubs {

struct Image8 {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgb;  // (height, width, 3)
};

struct View {
  std::string name;  // frame name without folder and extension; unique in its split
  Camera camera;
  Image8 image;  // empty (width 0) when the data folder has no image for the frame
};

struct Split {
  std::string name;  // train, val, test
  std::vector<View> views;
};

inline std::vector<Camera> cameras_of(const Split& split) {
  std::vector<Camera> cameras;
  for (const View& view : split.views) cameras.push_back(view.camera);
  return cameras;
}

}  // namespace ubs
