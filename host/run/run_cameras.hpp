// SPDX-License-Identifier: Apache-2.0
// These functions write and read the folder `cameras` of a run that refined its cameras. The folder contains
// a text model of COLMAP and a transforms.json. Both contain the cameras of the images as training used them
// (undistorted and reduced). They name the image files relative to the data folder. Undistorted images and
// images in packed files or videos have no image file that fits their camera, and are named SPLIT/VIEW.png.
// In transforms.json, the member "view" (SPLIT/VIEW) of each frame says which view it is; earlier versions
// named all images SPLIT/VIEW.png instead. The cameras of the training views are those that the run has
// refined; the cameras of the test views are those that fit the finished model best. If a run was
// interrupted, the files contain only the training views.
#pragma once

#include <array>
#include <filesystem>
#include <span>
#include <vector>

#include "host/scene/dataset.hpp"
#include "host/train/fit_camera.hpp"

namespace ubs {

struct RunCameras {
  const Split& split;
  std::span<const FittedCamera> cameras;  // one per view of the split
};

// Names of the files that write_run_cameras() writes.
inline constexpr std::array kRunCameraFiles{"cameras.txt", "images.txt", "points3D.txt", "transforms.json"};

// Writes the files into `folder`, with world coordinates. A position in the world is a position of `splits`
// plus `offset`. `data` is the data folder, or a file in it.
void write_run_cameras(const std::filesystem::path& folder, std::span<const RunCameras> splits,
                       const std::array<double, 3>& offset, const std::filesystem::path& data);

// Replaces the cameras of a split by those in the folder `folder` of a run. Training views get the poses and
// the intrinsics of the run. Views of other splits get only the intrinsics, because they are evaluated at the
// poses that the data state. Views that the run did not have are not changed.
void use_run_cameras(const std::filesystem::path& folder, Split& split, const std::array<double, 3>& offset);
// Returns the cameras of the run for all views of a split. Returns an empty list if the camera of a view is
// missing.
std::vector<Camera> run_cameras(const std::filesystem::path& folder, const Split& split,
                                const std::array<double, 3>& offset);

}  // namespace ubs
