// SPDX-License-Identifier: Apache-2.0
// Frames of transforms*.json files, as Blender, D-NeRF and nerfstudio folders have them: checked access
// to their fields, poses, intrinsics, names. For the loaders of this folder and for camera keyframes.
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

// A JSON object and the words that locate it in error messages.
struct Node {
  const Json& json;
  std::string where;

  bool has(const char* key) const { return json.contains(key); }
  double number(const char* key) const;                 // finite, else an error
  std::string text(const char* key) const;              // a non-empty string, else an error
  std::array<double, 3> vector(const char* key) const;  // three finite numbers, else an error
};

// An object with a non-empty array `list` of objects.
Json parse_file(const std::filesystem::path& path, const char* list = "frames");
Node frame_node(const Json& file, std::size_t index, const std::string& path);

// Camera-to-world with OpenGL axes (y up, z backward) -> world-to-camera with COLMAP axes (y down, z
// forward).
void set_pose(Camera& camera, const Node& frame);
// "world_to_camera" with COLMAP axes, as it stands.
void set_world_to_camera(Camera& camera, const Node& frame);

// A value of the frame, else of the whole file.
std::optional<double> lookup(const Node& frame, const Node& file, const char* key);

// "w" and "h", where both are given. Exporters of Blender write them before Blender cuts them to whole pixels
// (633.6): the size of the image file stands for those, where there is one and it differs by less than a
// pixel.
std::optional<ImageSize> stated_size(const Node& frame, const Node& file, const std::filesystem::path& image);

// `stated` is the size that pixel quantities of the JSON refer to, `actual` that of the loaded image.
void set_intrinsics(Camera& camera, const Node& frame, const Node& file, ImageSize stated, ImageSize actual);

// Returns the file of a frame, or the last component of its stated name where no file was found: what the
// view is named after.
std::filesystem::path shown_name(const std::filesystem::path& found, const std::string& stated);
std::string frame_name(const std::string& file_path);  // without folder and extension

}  // namespace ubs::frames
