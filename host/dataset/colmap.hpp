// SPDX-License-Identifier: Apache-2.0
// ColmapModel is a sparse model of COLMAP, which is stored in binary or in text files. It contains cameras
// with any lens model, poses and coloured points. The readers skip the two-dimensional observations and the
// tracks.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "host/dataset/lens.hpp"
#include "host/dataset/world_points.hpp"
#include "host/scene/load_report.hpp"

namespace ubs {

struct ColmapCamera {
  std::string model;  // PINHOLE, OPENCV, ...
  Lens lens;
};

struct ColmapImage {
  std::string name;                  // file name, relative to the image folder
  std::array<double, 4> rotation{};  // from world to camera, unit quaternion w x y z
  std::array<double, 3> translation{};
  std::uint32_t camera = 0;  // key in ColmapModel::cameras
};

struct ColmapModel {
  std::map<std::uint32_t, ColmapCamera> cameras;
  std::vector<ColmapImage> images;   // in file order
  std::set<std::uint32_t> unusable;  // numbers of the cameras whose parameters are not finite
  // Numbers of the other cameras that cannot be read, each with the error message. No image has such a
  // camera.
  std::map<std::uint32_t, std::string> refused;
  // Names of the images whose pose or camera is not finite. They are not in `images`.
  std::vector<std::string> unplaced;
  WorldPoints points;
  // The text file stores colours from 0 to 1 instead of 0 to 255. `points` contains the scaled colours.
  bool scaled_colours = false;
};

// Returns the folder of the model to use, which contains cameras.bin or cameras.txt. Searches `data`/sparse
// and the folders below it, then `data`/colmap/sparse, then `data` itself. If there are several models, the
// one called `name` is used, or the one with the most images for "auto"; the report says which one was used
// and why. Returns an empty path if there is no model.
std::filesystem::path find_colmap_model(const std::filesystem::path& data, const std::string& name = "auto",
                                        LoadReport* report = nullptr);

// Return the number of images that images.bin or images.txt lists. The first function reads both kinds of
// files, the second only text files. Both return 0 if the file does not exist, and the first one also if
// images.bin is too short.
std::size_t count_colmap_images(const std::filesystem::path& model);
std::size_t count_colmap_text_images(const std::filesystem::path& model);

// Reads a model. Each of its three files may be binary or text; if both exist, the binary one is read. The
// file of points may be missing.
ColmapModel read_colmap_model(const std::filesystem::path& model_folder);

// The following functions are shared by the readers of binary and of text files. Error messages start with
// `where`.

// Returns a camera of the lens model called `model`, whose parameters are in COLMAP's order.
ColmapCamera make_colmap_camera(const std::string& model, std::uint64_t width, std::uint64_t height,
                                const std::vector<double>& parameters, const std::string& where);
// Adds the camera to the model, or adds its number to `unusable` if its parameters are not finite, or to
// `refused` if it is not valid for another reason.
void add_colmap_camera(ColmapModel& model, std::uint32_t id, const std::string& name, std::uint64_t width,
                       std::uint64_t height, const std::vector<double>& parameters, const std::string& where);
// Returns the lens model with the given number in a binary file. Throws Error(data) for an unknown number.
const LensModel& colmap_model(int number, const std::string& where);
// Adds the image to the model, or adds its name to `unplaced` if its pose or its camera is not finite. Throws
// Error(data) if its camera is in `refused`.
void add_colmap_image(ColmapModel& model, ColmapImage image, const std::string& where);

// The following functions read text files and are defined in colmap_text.cpp.
void read_colmap_text_cameras(const std::filesystem::path& file, ColmapModel& model);
void read_colmap_text_images(const std::filesystem::path& file, ColmapModel& model);
void read_colmap_text_points(const std::filesystem::path& file, ColmapModel& model);

}  // namespace ubs
