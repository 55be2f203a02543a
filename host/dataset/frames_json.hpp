// SPDX-License-Identifier: Apache-2.0
// Node gives checked access to the fields of frames in the transforms*.json files of Blender, D-NeRF and
// nerfstudio data folders. The other functions of this file read poses, lenses, files and names. The loaders
// of host/dataset and the reader of camera keyframes use them.
#pragma once

#include <array>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/json.hpp"
#include "host/dataset/image.hpp"
#include "host/dataset/lens.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/dataset/named_files.hpp"
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
  // Returns false if there is no such field. Throws if the value is neither true nor false.
  bool flag(const char* key) const;
};

// Reads a JSON file. Throws unless its top level is an object whose member with the name `list` is an array
// of objects, which must not be empty unless `may_be_empty` is set.
Json parse_file(const std::filesystem::path& path, const char* list = "frames", bool may_be_empty = false);
// Returns the frame with the number `index`, counted from 0. `path` is the path of the file, for error
// messages.
Node frame_node(const Json& file, std::size_t index, const std::string& path);
// Returns all frames of the array with the name `list`. Throws if it is not an array of objects.
std::vector<Node> frame_nodes(const Json& file, const std::string& path, const char* list = "frames");

// Returns, for each frame, the file whose name is in the field `key` of the frame. The path is empty if the
// frame has no such field, or if the file does not exist.
std::vector<std::filesystem::path> stated_files(NamedFiles& files, const std::vector<Node>& frames,
                                                const char* key, const std::filesystem::path& folder,
                                                NamedFiles::Kind kind);
// Returns the image of each frame ("file_path"), or an empty path. With --images, the images are in that
// folder. There they have the names of the file paths without the folders that all of them have in common.
std::vector<std::filesystem::path> stated_images(NamedFiles& files, const std::vector<Node>& frames,
                                                 const std::filesystem::path& folder, DataRoot& root,
                                                 const DatasetOptions& options);
// Returns a sentence for the error message if none of the images exists: where the first one was searched
// for, and what to do.
std::string no_images(NamedFiles& files, const std::vector<Node>& frames, const std::filesystem::path& folder,
                      const DatasetOptions& options);
// Returns the number of masks. Throws if a frame names a mask that does not exist, although its image exists.
std::size_t count_masks(NamedFiles& files, const std::vector<Node>& frames,
                        const std::vector<std::filesystem::path>& images,
                        const std::vector<std::filesystem::path>& masks, const std::filesystem::path& folder);
// Reads the file of points that the field "ply_file_path" of the file names. If it does not exist, the report
// gets a note.
void take_stated_points(NamedFiles& files, const Node& file, const std::filesystem::path& folder,
                        LoadedScene& scene);

// Adds a note if the number of poses whose rotation was replaced by the nearest rotation is not 0.
void note_rounded_poses(std::size_t count, LoadReport& report);

// Throws if some of the frames have the field "time" and others do not.
void check_times(const std::vector<Node>& frames);

// Reads the pose from "transform_matrix", which is a camera-to-world matrix with OpenGL axes (y up, z
// backward), and converts it to a world-to-camera pose with COLMAP axes (y down, z forward). Returns true if
// the matrix was replaced by the nearest rotation (settle_rotation()).
bool set_pose(Camera& camera, const Node& frame);
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
std::optional<ImageSize> stated_size(const Node& frame, const Node& file, const std::filesystem::path& image,
                                     const char* width_key = "w", const char* height_key = "h");

// Sets the image size, the focal lengths and the principal point. `stated` is the image size that quantities
// in pixels of the JSON refer to, and `actual` is the size of the loaded image.
void set_intrinsics(Camera& camera, const Node& frame, const Node& file, ImageSize stated, ImageSize actual);

// Reads the camera model and its parameters. `size` is the size of the image that they refer to. Throws if
// the frame or the file has fields of other programs that describe a lens or a shutter that ubs does not
// know.
Lens read_lens(const Node& frame, const Node& file, ImageSize size);
// Returns the name of the camera model. instant-ngp writes is_fisheye instead of a name. The model is OPENCV
// if the JSON has neither.
std::string camera_model(const Node& frame, const Node& file);

// Returns the path that the view is named after. This is `found`, the path of the image, or the last
// component of `stated`, the name in the JSON, if the image was not found.
std::filesystem::path shown_name(const std::filesystem::path& found, const std::string& stated);
// Returns the file name without folder and image extension.
std::string frame_name(const std::string& file_path);

}  // namespace ubs::frames
