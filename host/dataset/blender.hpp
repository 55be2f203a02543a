// SPDX-License-Identifier: Apache-2.0
// load_blender_split() loads one split of a data folder in the layout of NeRF Synthetic and D-NeRF:
// transforms_{train,val,test}.json next to the image folders (method.md 4.5, 4.6). load_blender()
// (load_dataset.hpp) loads all splits.
#pragma once

#include <filesystem>
#include <string>

#include "host/dataset/load_dataset.hpp"

namespace ubs {

bool has_blender_split(const std::filesystem::path& folder, const std::string& split);

// Loads the cameras and the images of the split that is called `split`.
//
// Times are scaled and shifted so that the times of the train split range from 0 to 1. If there is no train
// split, the time range of the split itself is used.
//
// Focal length and principal point come from the frame, or from the top level of the file if the frame does
// not have them. If the same place contains a focal length and an angle of view for the same axis (fl_x and
// camera_angle_x, or fl_y and camera_angle_y), the angle is ignored. fy = fx if no field describes y. Without
// cx and cy the principal point is the image centre. Quantities in pixels refer to the image size w x h in
// the JSON file. They are rescaled if the image file has another size.
//
// A view whose image file does not exist is kept with an empty image if the JSON has w and h. In contrast,
// load_blender() skips such views if options.load_images is set.
Split load_blender_split(const std::filesystem::path& folder, const std::string& split,
                         const DatasetOptions& options = {});

}  // namespace ubs
