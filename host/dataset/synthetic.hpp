// SPDX-License-Identifier: Apache-2.0
// export_synthetic() writes procedural data sets with exact cameras, for tests, benchmarks and first steps
// without a download. The data sets are ordinary folders in the Blender / D-NeRF layout, so they are loaded
// like any other data. The scenes are:
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

// Horizontal angle of view of the cameras [rad], and their distance from the point that they look at. Both
// are those of NeRF Synthetic.
inline constexpr double kSyntheticAngleX = 0.6911112, kSyntheticDistance = 4.0311289;

struct SyntheticOptions {
  std::string scene = "glossy";
  int width = 100, height = 100;                        // size of the images [px]
  int train_views = 40, test_views = 8, val_views = 0;  // a split with 0 views has no JSON file
  int supersampling = 3;                                // rays per pixel along each axis
  std::uint64_t seed = 0;                               // determines the cameras and the shape of the cloud
  bool overwrite = false;                               // replaces files of an earlier export
};

std::vector<std::string> synthetic_scene_names();

// Writes a data set into the folder `out`. Equal options give identical bytes. Throws Error(usage) if a file
// that would be written exists and options.overwrite is false. Other files in the folder are not changed. The
// JSON files are written last, so an interrupted export has no JSON file and cannot be mistaken for a
// complete one.
void export_synthetic(const SyntheticOptions& options, const std::filesystem::path& out);

}  // namespace ubs
