// SPDX-License-Identifier: Apache-2.0
// Node gives checked access to the fields of frames in the transforms*.json files of Blender, D-NeRF and
// nerfstudio data folders. The other functions of this file read poses, intrinsics and names. The loaders of
// host/data and the reader of camera keyframes use them.
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

// Node refers to a JSON object and holds the text that locates it in error messages.
struct Node {
  const Json& json;
  std::string where;

  bool has(const char* key) const { return json.contains(key); }
  // The following functions return the value of the field `key`. They throw unless the value is a finite
  // number, a non-empty string or an array of three finite numbers, respectively.
  double number(const char* key) const;
  std::string text(const char* key) const;
  std::array<double, 3> vector(const char* key) const;
};

// Reads a JSON file. Throws unless its top level is an object whose member with the name `list` is a
// non-empty array of objects.
Json parse_file(const std::filesystem::path& path, const char* list = "frames");
// Returns the frame with the number `index`, counted from 0. `path` is the path of the file, for error
// messages.
Node frame_node(const Json& file, std::size_t index, const std::string& path);

// Reads the pose from "transform_matrix", which is a camera-to-world matrix with OpenGL axes (y up, z
// backward), and converts it to a world-to-camera pose with COLMAP axes (y down, z forward).
void set_pose(Camera& camera, const Node& frame);
// Reads the pose from "world_to_camera", which is a world-to-camera matrix with COLMAP axes, so it is not
// converted.
void set_world_to_camera(Camera& camera, const Node& frame);

// Returns the number in the field `key` of the frame. If the frame has no such field, returns the number in
// this field of the top level of the file, or nullopt if there is none either.
std::optional<double> lookup(const Node& frame, const Node& file, const char* key);

// Returns "w" and "h" if both are present. They may be fractional (such as 633.6), because Blender exporters
// write them before Blender truncates them to whole pixels. For a fractional size, the size of the image file
// is returned if the file exists and its width and height differ from "w" and "h" by less than a pixel. Any
// other fractional size is an error.
std::optional<ImageSize> stated_size(const Node& frame, const Node& file, const std::filesystem::path& image);

// Sets the image size, the focal lengths and the principal point. `stated` is the image size that quantities
// in pixels of the JSON refer to, and `actual` is the size of the loaded image.
void set_intrinsics(Camera& camera, const Node& frame, const Node& file, ImageSize stated, ImageSize actual);

// Returns the path that the view is named after. This is `found`, the path of the image, or the last
// component of `stated`, the name in the JSON, if the image was not found.
std::filesystem::path shown_name(const std::filesystem::path& found, const std::string& stated);
// Returns the file name without folder and image extension.
std::string frame_name(const std::string& file_path);

}  // namespace ubs::frames
