// SPDX-License-Identifier: Apache-2.0
// Writes and reads the folder `cameras` of a run that refined its cameras. It contains a text model of COLMAP
// and a transforms.json. Both describe the images as they were used in training (undistorted and reduced),
// named SPLIT/VIEW.png. The training views have their refined cameras; the test views have the cameras that
// fit the finished model best. An interrupted run has only the training views.
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

// The files that write_run_cameras() writes.
inline constexpr std::array kRunCameraFiles{"cameras.txt", "images.txt", "points3D.txt", "transforms.json"};

// `offset` is that of the cameras: world = local + offset.
void write_run_cameras(const std::filesystem::path& folder, std::span<const RunCameras> splits,
                       const std::array<double, 3>& offset);

// Sets the cameras that the run found. Training views get the run's complete cameras; views of other splits
// get only the intrinsics, because their given poses are used for evaluation. Views that the run did not have
// are not changed.
void use_run_cameras(const std::filesystem::path& folder, Split& split, const std::array<double, 3>& offset);
// Returns the cameras that the run found for all views of a split; empty if one is missing.
std::vector<Camera> run_cameras(const std::filesystem::path& folder, const Split& split,
                                const std::array<double, 3>& offset);

}  // namespace ubs
