// SPDX-License-Identifier: Apache-2.0
// Sparse models of COLMAP, binary or text, as they are in the files: cameras with any lens model, poses,
// coloured points. Two-dimensional observations and tracks are passed over.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "host/data/lens.hpp"
#include "host/data/world_points.hpp"

namespace ubs {

struct ColmapCamera {
  std::string model;  // PINHOLE, OPENCV, ...
  Lens lens;
};

struct ColmapImage {
  std::string name;                  // file, relative to the folder of images
  std::array<double, 4> rotation{};  // world -> camera, unit quaternion w x y z
  std::array<double, 3> translation{};
  std::uint32_t camera = 0;
};

struct ColmapModel {
  std::map<std::uint32_t, ColmapCamera> cameras;
  std::vector<ColmapImage> images;  // in file order
  WorldPoints points;
};

// The folder with cameras.bin or cameras.txt: `data`/sparse/0, `data`/sparse or `data` itself; empty when
// there is none.
std::filesystem::path find_colmap_model(const std::filesystem::path& data);

// Error(data) that names the models in sparse/1 and the like, where there are any.
void refuse_further_models(const std::filesystem::path& data);

// Binary files are preferred where both kinds exist. points3D may be missing.
ColmapModel read_colmap_model(const std::filesystem::path& model_folder);

// For the readers of both kinds: parameters in COLMAP's order -> lens. `where` starts messages.
ColmapCamera make_colmap_camera(const std::string& model, std::uint64_t width, std::uint64_t height,
                                const std::vector<double>& parameters, const std::string& where);
// Name of a model number, and how many parameters a model has; an error for unknown ones.
std::string colmap_model_name(int id, const std::string& where);
std::size_t colmap_parameter_count(const std::string& model, const std::string& where);
void add_colmap_image(ColmapModel& model, ColmapImage image, const std::string& where);

ColmapModel read_colmap_text(const std::filesystem::path& folder);  // colmap_text.cpp

}  // namespace ubs
