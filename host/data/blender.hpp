// SPDX-License-Identifier: Apache-2.0
// Data folders in the layout of NeRF Synthetic and D-NeRF: transforms_{train,val,test}.json beside the
// image folders (method.md 4.5, 4.6). Every inconsistency is an error naming the file and the frame.
#pragma once

#include <filesystem>
#include <string>

#include "host/data/load_dataset.hpp"

namespace ubs {

bool has_blender_split(const std::filesystem::path& folder, const std::string& split);

// A view whose image file does not exist is kept with an empty image when the JSON gives w and h.
// Times are normalised with the range of the TRAIN file for every split.
//
// Focal length and principal point come from the frame, else from the file: fl_x/fl_y before
// camera_angle_x/_y at the same level, fy = fx when nothing describes y, the image centre without cx, cy.
// Pixel quantities refer to w x h of the JSON and are rescaled when the image has another size.
// `lazy`: views get a source instead of pixels. With a `report`, views without an image file are left out
// where other views of the split have theirs, and the split is empty where none has and images are wanted;
// the report says so.
Split load_blender_split(const std::filesystem::path& folder, const std::string& split,
                         const DatasetOptions& options = {}, bool lazy = false, LoadReport* report = nullptr);

}  // namespace ubs
