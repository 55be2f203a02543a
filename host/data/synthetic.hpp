// SPDX-License-Identifier: Apache-2.0
// Procedural data sets with exact cameras, for tests, benchmarks and first steps without a download.
// They are written as ordinary Blender / D-NeRF folders, so everything downstream treats them as data.
//   glossy   static; mirror, metal and plastic on a textured slab: reflections and highlights move
//            with the view
//   orbit    dynamic, time in [0,1]: bodies that travel, bounce, turn, change colour, appear and vanish
//   cloud    static emission-absorption volume with soft borders: real alpha everywhere
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace ubs {

// The cameras of NeRF Synthetic: horizontal angle of view [rad], distance from the origin.
inline constexpr double kSyntheticAngleX = 0.6911112, kSyntheticDistance = 4.0311289;

struct SyntheticOptions {
  std::string scene = "glossy";
  int width = 100, height = 100;
  int train_views = 40, test_views = 8, val_views = 0;  // a split with 0 views has no JSON file
  int supersampling = 3;                                // rays per pixel and axis
  std::uint64_t seed = 0;                               // places the cameras; shapes the cloud
  bool overwrite = false;                               // files of these names, of an earlier export
};

std::vector<std::string> synthetic_scene_names();

// Equal options give equal bytes. Throws Error(usage) if files of its names exist in `out` and
// options.overwrite is false; other files there are left alone. The JSON files come last: an interrupted
// export has none and cannot be mistaken for a complete one.
void export_synthetic(const SyntheticOptions& options, const std::filesystem::path& out);

}  // namespace ubs
