// SPDX-License-Identifier: Apache-2.0
// Sparse models of COLMAP, binary or text, as they are in the files: cameras with any lens model, poses,
// coloured points. Two-dimensional observations and tracks are passed over.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "host/data/lens.hpp"
#include "host/data/load_report.hpp"
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
  std::vector<ColmapImage> images;    // in file order
  std::set<std::uint32_t> unusable;   // numbers of cameras whose parameters are not finite
  std::vector<std::string> unplaced;  // names of images whose pose or camera is not finite: not in `images`
  WorldPoints points;
  bool scaled_colours = false;  // the text file has colours from 0 to 1
};

// Returns the folder with cameras.bin or cameras.txt: of the models in `data`/sparse and the folders below it
// (else in `data`/colmap/sparse, else `data` itself) the one with the most images, or the one called `name`.
// Empty when there is none. Where there are several, the report says which is used and why.
std::filesystem::path find_colmap_model(const std::filesystem::path& data, const std::string& name = "auto",
                                        LoadReport* report = nullptr);

// Returns how many images a model says that it has, without reading them; 0 for a damaged one.
std::size_t count_colmap_images(const std::filesystem::path& model);
std::size_t count_colmap_text_images(const std::filesystem::path& model);

// Binary files are preferred where both kinds exist. points3D may be missing.
ColmapModel read_colmap_model(const std::filesystem::path& model_folder);

// For the readers of both kinds: parameters in COLMAP's order -> lens. `where` starts messages.
ColmapCamera make_colmap_camera(const std::string& model, std::uint64_t width, std::uint64_t height,
                                const std::vector<double>& parameters, const std::string& where);
// Puts the camera into the model, or its number into `unusable`.
void add_colmap_camera(ColmapModel& model, std::uint32_t id, const std::string& name, std::uint64_t width,
                       std::uint64_t height, const std::vector<double>& parameters, const std::string& where);
// Returns the row of a number of a binary file; throws Error(data) for an unknown one.
const LensModel& colmap_model(int number, const std::string& where);
void add_colmap_image(ColmapModel& model, ColmapImage image, const std::string& where);

// colmap_text.cpp
ColmapModel read_colmap_text(const std::filesystem::path& folder);
void read_colmap_text_points(const std::filesystem::path& file, ColmapModel& model);

}  // namespace ubs
