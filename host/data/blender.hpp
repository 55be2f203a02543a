// SPDX-License-Identifier: Apache-2.0
// Data folders in the layout of NeRF Synthetic and D-NeRF: transforms_{train,val,test}.json beside the
// image folders (method.md 4.5, 4.6). Every inconsistency is an error naming the file and the frame.
#pragma once

#include <array>
#include <filesystem>
#include <string>

#include "host/scene/dataset.hpp"

namespace ubs {

struct BlenderOptions {
  std::array<double, 3> background{0, 0, 0};
  bool load_images = true;  // false: cameras only, every image empty
  bool lazy = false;        // true: views get a source instead of pixels
  int downscale = 1;
  bool allow_outside = false;  // data_root.hpp
};

bool has_blender_split(const std::filesystem::path& folder, const std::string& split);

// A view whose image file does not exist is kept with an empty image when the JSON gives w and h.
// Times are normalised with the range of the TRAIN file for every split.
//
// Focal length and principal point come from the frame, else from the file: fl_x/fl_y before
// camera_angle_x/_y at the same level, fy = fx when nothing describes y, the image centre without cx, cy.
// Pixel quantities refer to w x h of the JSON and are rescaled when the image has another size.
Split load_blender_split(const std::filesystem::path& folder, const std::string& split,
                         const BlenderOptions& options = {});

}  // namespace ubs
