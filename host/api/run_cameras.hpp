// SPDX-License-Identifier: Apache-2.0
// The folder `cameras` of a run that refined its cameras: a text model of COLMAP and a transforms.json, both
// of the images as they were trained on (without distortion, reduced), named SPLIT/VIEW.png. The training
// views have their refined cameras, the test views those that fit the finished model best. An interrupted
// run has the training views alone.
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
  std::span<const FittedCamera> cameras;  // of its views
};

// The files that write_run_cameras() writes.
inline constexpr std::array kRunCameraFiles{"cameras.txt", "images.txt", "points3D.txt", "transforms.json"};

// `offset`: of the cameras in the world.
void write_run_cameras(const std::filesystem::path& folder, std::span<const RunCameras> splits,
                       const std::array<double, 3>& offset);

// Views of the training split get the run's cameras, those of others the lenses alone: their poses are given.
// Views that the run did not have stay as they are.
void use_run_cameras(const std::filesystem::path& folder, Split& split, const std::array<double, 3>& offset);
// Those that the run has found for all views of a split; empty where it has not all of them.
std::vector<Camera> run_cameras(const std::filesystem::path& folder, const Split& split,
                                const std::array<double, 3>& offset);

}  // namespace ubs
