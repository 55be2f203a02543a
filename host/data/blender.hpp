// SPDX-License-Identifier: Apache-2.0
// load_blender_split() loads one split of a data folder in the layout of NeRF Synthetic and D-NeRF:
// transforms_{train,val,test}.json next to the image folders (method.md 4.5, 4.6). Every inconsistency is an
// error that names the file and the frame.
#pragma once

#include <filesystem>
#include <string>

#include "host/data/load_dataset.hpp"

namespace ubs {

bool has_blender_split(const std::filesystem::path& folder, const std::string& split);

// Without a `report`, a view whose image file does not exist is kept with an empty image if the JSON has w
// and h. Times of all splits are normalised with the range of the TRAIN file.
//
// Focal length and principal point come from the frame, or from the file if the frame does not have them. On
// each level, fl_x/fl_y take precedence over camera_angle_x/_y. fy = fx if no field describes y. Without cx
// and cy the principal point is the image centre. Quantities in pixels refer to w x h of the JSON and are
// rescaled if the image has another size.
// `lazy`: views get a source instead of pixels.
// `report`: if it is passed and images are wanted, a missing image of the train split is an error. In other
// splits, views without an image file are skipped; if all of them lack one, the split is empty. The report
// says so.
Split load_blender_split(const std::filesystem::path& folder, const std::string& split,
                         const DatasetOptions& options = {}, bool lazy = false, LoadReport* report = nullptr);

}  // namespace ubs
