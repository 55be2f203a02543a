// SPDX-License-Identifier: Apache-2.0
// Node gives checked access to the fields of frames in transforms*.json files of Blender, D-NeRF and
// nerfstudio folders. Other functions of this file read poses, intrinsics and names. The loaders of this
// folder and the reader of camera keyframes use them.
#pragma once

#include <array>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/json.hpp"
#include "host/data/image.hpp"
#include "host/scene/dataset.hpp"

namespace ubs::frames {

// A JSON object, and the text that locates it in error messages.
struct Node {
  const Json& json;
  std::string where;

  bool has(const char* key) const { return json.contains(key); }
  double number(const char* key) const;                 // throws unless it is a finite number
  std::string text(const char* key) const;              // throws unless it is a non-empty string
  std::array<double, 3> vector(const char* key) const;  // throws unless it is three finite numbers
};

// Reads a JSON file. Throws unless it is an object with a non-empty array `list` of objects.
Json parse_file(const std::filesystem::path& path, const char* list = "frames");
Node frame_node(const Json& file, std::size_t index, const std::string& path);

// Reads the pose. Converts camera-to-world with OpenGL axes (y up, z backward) to world-to-camera with COLMAP
// axes (y down, z forward).
void set_pose(Camera& camera, const Node& frame);
// Reads "world_to_camera", which has COLMAP axes, without conversion.
void set_world_to_camera(Camera& camera, const Node& frame);

// Returns a value of the frame, or that of the whole file if the frame does not have it.
std::optional<double> lookup(const Node& frame, const Node& file, const char* key);

// Returns "w" and "h" if both are present. They may be fractional (such as 633.6), because Blender exporters
// write them before Blender truncates them to whole pixels. For a fractional size, the size of the image file
// is returned if the file exists and differs by less than a pixel.
std::optional<ImageSize> stated_size(const Node& frame, const Node& file, const std::filesystem::path& image);

// `stated` is the size that pixel quantities of the JSON refer to, `actual` the size of the loaded image.
void set_intrinsics(Camera& camera, const Node& frame, const Node& file, ImageSize stated, ImageSize actual);

// Returns the file that the view is named after: the file of the frame, or the last component of its stated
// name if no file was found.
std::filesystem::path shown_name(const std::filesystem::path& found, const std::string& stated);
std::string frame_name(const std::string& file_path);  // without folder and extension

}  // namespace ubs::frames
