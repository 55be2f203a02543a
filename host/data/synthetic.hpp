// SPDX-License-Identifier: Apache-2.0
// export_synthetic() writes procedural data sets with exact cameras, for tests, benchmarks and first steps
// without a download. They are ordinary Blender / D-NeRF folders, so all other code treats them like any
// data. The scenes are:
//   glossy   static; mirror, metal and plastic on a textured slab: reflections and highlights move
//            with the view
//   orbit    dynamic, time in [0,1]: bodies that travel, bounce, rotate, change colour, appear and vanish
//   cloud    static emission-absorption volume with soft borders: partial transparency everywhere
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace ubs {

// Cameras as in NeRF Synthetic: horizontal angle of view [rad], distance from the origin.
inline constexpr double kSyntheticAngleX = 0.6911112, kSyntheticDistance = 4.0311289;

struct SyntheticOptions {
  std::string scene = "glossy";
  int width = 100, height = 100;
  int train_views = 40, test_views = 8, val_views = 0;  // a split with 0 views has no JSON file
  int supersampling = 3;                                // rays per pixel along each axis
  std::uint64_t seed = 0;                               // determines the cameras and the shape of the cloud
  bool overwrite = false;                               // replace files of these names from an earlier export
};

std::vector<std::string> synthetic_scene_names();

// Writes a data set. Equal options give identical bytes. Throws Error(usage) if files of the same names exist
// in `out` and options.overwrite is false; does not touch other files there. The JSON files are written last,
// so an interrupted export has none and cannot be mistaken for a complete one.
void export_synthetic(const SyntheticOptions& options, const std::filesystem::path& out);

}  // namespace ubs
