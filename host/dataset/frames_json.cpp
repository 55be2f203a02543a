// SPDX-License-Identifier: Apache-2.0
// See frames_json.hpp.
#include "host/dataset/frames_json.hpp"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <system_error>

#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/base/paths.hpp"
#include "host/dataset/name_index.hpp"

namespace ubs::frames {

namespace fs = std::filesystem;

namespace {

// RigidMotion holds the first three rows of the matrix of a rigid motion.
struct RigidMotion {
  std::array<double, 12> rows{};
  bool settled = false;  // the rotation in the file was replaced by the nearest rotation
};

// Reads a rigid motion, which the JSON stores as an array of three or four rows with four numbers each.
RigidMotion read_matrix(const Node& frame, const char* key) {
  if (!frame.has(key)) fail(ErrorKind::data, "{}: '{}' is missing", frame.where, key);
  const Json& rows = frame.json[key];
  const auto wrong_shape = [&] {
    fail(ErrorKind::data, "{}: '{}' must be 4x4 (or 3x4) numbers", frame.where, key);
  };
  if (!rows.is_array() || (rows.size() != 3 && rows.size() != 4)) wrong_shape();
  RigidMotion motion;
  std::array<double, 12>& matrix = motion.rows;
  for (std::size_t r = 0; r < rows.size(); ++r) {
    if (!rows[r].is_array() || rows[r].size() != 4) wrong_shape();
    for (std::size_t c = 0; c < 4; ++c) {
      if (!rows[r][c].is_number()) wrong_shape();
      const double value = checked_input(rows[r][c].get<double>(), fmt::format("{}: '{}'", frame.where, key));
      if (r < 3) matrix[4 * r + c] = value;
      if (r == 3 && std::abs(value - (c == 3 ? 1.0 : 0.0)) > 1e-6)
        fail(ErrorKind::data, "{}: last row of '{}' must be 0 0 0 1", frame.where, key);
    }
  }
  std::array<double, 9> rotation{matrix[0], matrix[1], matrix[2], matrix[4], matrix[5],
                                 matrix[6], matrix[8], matrix[9], matrix[10]};
  motion.settled = settle_rotation(rotation);
  check_rotation(rotation, fmt::format("{}: '{}'", frame.where, key));
  if (motion.settled)
    for (std::size_t i = 0; i < 9; ++i) matrix[i / 3 * 4 + i % 3] = rotation[i];
  return motion;
}

// Returns the focal length in pixels, or nullopt if neither the frame nor the file states it. A value of the
// frame takes precedence over a value of the file. Within each of them, a value in pixels takes precedence
// over an angle, because Blender exporters write the angles of the sensor, whose aspect ratio may differ from
// that of the image. `extent` is the width or the height of the image that an angle refers to [px].
std::optional<double> focal_length(const Node& frame, const Node& file, const char* angle_key,
                                   const char* pixel_key, double extent) {
  for (const Node* node : {&frame, &file}) {
    if (node->has(pixel_key)) {
      const double focal = node->number(pixel_key);
      if (focal <= 0) fail(ErrorKind::data, "{}: '{}' = {} must be positive", node->where, pixel_key, focal);
      return focal;
    }
    if (node->has(angle_key)) {
      const double angle = node->number(angle_key);
      if (!(angle > 0 && angle < 3.14159))
        fail(ErrorKind::data, "{}: '{}' = {} must be between 0 and pi", node->where, angle_key, angle);
      return extent / (2.0 * std::tan(angle / 2.0));
    }
  }
  return std::nullopt;
}

}  // namespace

double Node::number(const char* key) const {
  const Json& value = json.at(key);
  if (!value.is_number()) fail(ErrorKind::data, "{}: '{}' must be a number", where, key);
  return checked_input(value.get<double>(), fmt::format("{}: '{}'", where, key));
}

std::string Node::text(const char* key) const {
  if (!has(key)) fail(ErrorKind::data, "{}: '{}' is missing", where, key);
  const Json& value = json.at(key);
  if (!value.is_string() || value.get<std::string>().empty())
    fail(ErrorKind::data, "{}: '{}' must be a non-empty string", where, key);
  return value.get<std::string>();
}

std::array<double, 3> Node::vector(const char* key) const {
  if (!has(key)) fail(ErrorKind::data, "{}: '{}' is missing", where, key);
  const Json& values = json.at(key);
  const auto bad = [&] { fail(ErrorKind::data, "{}: '{}' must be three finite numbers", where, key); };
  if (!values.is_array() || values.size() != 3) bad();
  std::array<double, 3> result{};
  for (std::size_t i = 0; i < 3; ++i) {
    if (!values[i].is_number()) bad();
    result[i] = checked_input(values[i].get<double>(), fmt::format("{}: '{}'", where, key));
  }
  return result;
}

bool Node::flag(const char* key) const {
  if (!has(key)) return false;
  const Json& value = json.at(key);
  if (!value.is_boolean()) fail(ErrorKind::data, "{}: '{}' must be true or false", where, key);
  return value.get<bool>();
}

namespace {

// First character of a string that replaces a word which JSON does not allow, such as NaN.
constexpr char kMarker = '\1';

// Returns the text with every word for a number that is not finite replaced by a marked string. JSON does not
// allow these words, but Python's json module writes NaN and Infinity, and other programs write nan and inf.
std::string with_marked_nan(const std::string& text) {
  std::string result;
  bool in_string = false;
  for (std::size_t i = 0; i < text.size();) {
    std::string_view found;
    for (const std::string_view word : {"-Infinity", "Infinity", "-NaN", "NaN", "-inf", "inf", "-nan", "nan"})
      if (!in_string && found.empty() && std::string_view(text).substr(i, word.size()) == word) found = word;
    if (!found.empty()) {
      result += fmt::format("\"\\u0001{}\"", found);
      i += found.size();
      continue;
    }
    if (in_string && text[i] == '\\' && i + 1 < text.size())
      result += text[i++];
    else if (text[i] == '"')
      in_string = !in_string;
    result += text[i++];
  }
  return result;
}

// Throws if `json` is or contains a marked string. The message contains `field`, the name of the outermost
// member that contains the string. Callers pass an empty string; recursive calls pass the name.
void refuse_marked(const Json& json, const std::string& field, const std::string& where) {
  if (json.is_string() && json.get_ref<const std::string&>().starts_with(kMarker))
    fail(ErrorKind::data, "{}: '{}' has the value {}, which is not a finite number", where, field,
         json.get_ref<const std::string&>().substr(1));
  if (!json.is_structured()) return;
  for (const auto& [key, value] : json.items()) refuse_marked(value, field.empty() ? key : field, where);
}

// If the text is valid JSON except for NaN and Infinity, throws Error(data) with a message that names the
// frame and the field. `list` is the name of the array that contains the frames.
void refuse_nan(const std::string& text, const std::string& name, const char* list) {
  Json json;
  try {
    json = parse_json(with_marked_nan(text), name);
  } catch (const Error&) {  // the text is also damaged in another way, which the first error describes
    return;
  }
  if (const Json frames = json.is_object() ? json.value(list, Json()) : Json(); frames.is_array())
    for (std::size_t i = 0; i < frames.size(); ++i)
      refuse_marked(frames[i], "",
                    fmt::format("{}: {} {}", name, std::string(list, std::strlen(list) - 1), i));
  refuse_marked(json, "", name);
}

}  // namespace

namespace {

// Throws unless all elements of the array with the name `list` are objects.
void check_objects(const Json& file, const std::string& path, const char* list) {
  for (std::size_t i = 0; i < file[list].size(); ++i)
    if (!file[list][i].is_object())
      fail(ErrorKind::data, "{}: {} {}: must be an object", path, std::string(list, std::strlen(list) - 1),
           i);
}

}  // namespace

Json parse_file(const fs::path& path, const char* list, bool may_be_empty) {
  const std::string text = read_text_file(path);
  Json json;
  try {
    json = parse_json(text, path.string());
  } catch (const Error&) {
    refuse_nan(text, path.string(), list);
    throw;
  }
  if (!json.is_object()) fail(ErrorKind::data, "{}: the top level must be an object", path.string());
  limit_members(json, path.string());
  if (!json.contains(list)) fail(ErrorKind::data, "{}: field '{}' is missing", path.string(), list);
  if (!json[list].is_array() || (json[list].empty() && !may_be_empty))
    fail(ErrorKind::data, "{}: '{}' must be a non-empty array", path.string(), list);
  check_objects(json, path.string(), list);
  return json;
}

Node frame_node(const Json& file, std::size_t index, const std::string& path) {
  return {file["frames"][index], fmt::format("{}: frame {}", path, index)};
}

std::vector<Node> frame_nodes(const Json& file, const std::string& path, const char* list) {
  if (!file[list].is_array()) fail(ErrorKind::data, "{}: '{}' must be an array", path, list);
  check_objects(file, path, list);
  const std::string what(list, std::strlen(list) - 1);
  std::vector<Node> nodes;
  nodes.reserve(file[list].size());
  for (const Json& frame : file[list])
    nodes.push_back({frame, fmt::format("{}: {} {}", path, what, nodes.size())});
  return nodes;
}

std::vector<fs::path> stated_files(NamedFiles& files, const std::vector<Node>& frames, const char* key,
                                   const fs::path& folder, NamedFiles::Kind kind) {
  std::vector<StatedName> names;
  std::vector<std::size_t> of_frame;
  for (std::size_t i = 0; i < frames.size(); ++i)
    if (frames[i].has(key)) names.push_back({frames[i].text(key), frames[i].where}), of_frame.push_back(i);
  const std::vector<fs::path> found = files.find(folder, names, kind);
  std::vector<fs::path> result(frames.size());
  for (std::size_t i = 0; i < found.size(); ++i) result[of_frame[i]] = found[i];
  return result;
}

namespace {

// Returns the folders that all names have in common, as the number of their components.
std::size_t common_folders(const std::vector<StatedName>& names) {
  std::vector<std::string> common;
  for (std::size_t i = 0; i < names.size(); ++i) {
    std::vector<std::string> parts = path_components(names[i].name);
    if (!parts.empty()) parts.pop_back();
    if (i == 0) common = parts;
    const auto end = std::ranges::mismatch(common, parts).in1;
    common.erase(end, common.end());
  }
  return common.size();
}

// Returns the names of the images in the folder that --images selects.
std::vector<StatedName> names_in_folder(const std::vector<Node>& frames) {
  std::vector<StatedName> names;
  for (const Node& frame : frames) names.push_back({frame.text("file_path"), frame.where});
  const auto skipped = static_cast<std::ptrdiff_t>(common_folders(names));
  for (StatedName& name : names) {
    const std::vector<std::string> parts = path_components(name.name);
    if (!parts.empty()) name.name = fmt::format("{}", fmt::join(parts.begin() + skipped, parts.end(), "/"));
  }
  return names;
}

}  // namespace

std::vector<fs::path> stated_images(NamedFiles& files, const std::vector<Node>& frames,
                                    const fs::path& folder, DataRoot& root, const DatasetOptions& options) {
  if (options.read.images == "auto")
    return stated_files(files, frames, "file_path", folder, NamedFiles::Kind::image);
  const fs::path base = folder / options.read.images;
  if (options.load_images && !is_folder(base))
    fail(ErrorKind::data, "{}: the image folder '{}' does not exist", folder.string(), options.read.images);
  if (options.images_from_user) root.add(base);
  return files.find(base, names_in_folder(frames), NamedFiles::Kind::image, true);
}

std::string no_images(NamedFiles& files, const std::vector<Node>& frames, const fs::path& folder,
                      const DatasetOptions& options) {
  if (options.read.images != "auto")
    return fmt::format("none of the {} images exists: for example, {}; pass another folder with --images",
                       frames.size(),
                       files.missing(folder / options.read.images, names_in_folder(frames)[0].name));
  // Some data sets only contain folders of reduced images, such as images_2 and images_4.
  std::string hint = "copy the images there or correct 'file_path'";
  for (const fs::path& entry : folder_entries(folder.empty() ? fs::path(".") : folder))
    if (is_folder(entry) && !pictures_in(entry).empty()) {
      hint +=
          fmt::format(", or pass the folder of the images, such as --images {}", entry.filename().string());
      break;
    }
  return fmt::format("none of the {} images exists: for example, {}; {}", frames.size(),
                     files.missing(folder, frames[0].text("file_path")), hint);
}

std::size_t count_masks(NamedFiles& files, const std::vector<Node>& frames,
                        const std::vector<fs::path>& images, const std::vector<fs::path>& masks,
                        const fs::path& folder) {
  std::size_t count = 0;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (images[i].empty()) continue;
    if (masks[i].empty() && frames[i].has("mask_path"))
      fail(ErrorKind::data, "{}: the mask {}; copy the masks there or correct 'mask_path'", frames[i].where,
           files.missing(folder, frames[i].text("mask_path")));
    count += !masks[i].empty();
  }
  return count;
}

void take_stated_points(NamedFiles& files, const Node& file, const fs::path& folder, LoadedScene& scene) {
  if (!file.has("ply_file_path")) return;
  const std::string name = file.text("ply_file_path");
  const fs::path points = files.find(folder, {{name, file.where}}, NamedFiles::Kind::points).front();
  if (points.empty())
    scene.report.note_difference(fmt::format("'ply_file_path': {}", files.missing(folder, name)));
  else
    take_points(points, scene);
}

void note_rounded_poses(std::size_t count, LoadReport& report) {
  if (count > 0)
    report.note_difference(
        fmt::format("{} poses were rounded so coarsely that their matrices are not rotations: the nearest "
                    "rotations are used",
                    count));
}

void check_times(const std::vector<Node>& frames) {
  const auto has_time = [](const Node& frame) { return frame.has("time"); };
  const auto with = std::ranges::find_if(frames, has_time);
  const auto without = std::ranges::find_if_not(frames, has_time);
  if (with != frames.end() && without != frames.end())
    fail(ErrorKind::data,
         "{}: 'time' is missing, although other frames have it ({}): add 'time' to every frame, or remove it "
         "from all of them",
         without->where, with->where);
}

// The file stores a camera-to-world matrix with OpenGL axes (y up, z backward). This function computes the
// world-to-camera pose with COLMAP axes (y down, z forward). It negates columns 1 and 2, then inverts the
// matrix. The inverse of a rotation is its transpose.
bool set_pose(Camera& camera, const Node& frame) {
  const RigidMotion motion = read_matrix(frame, "transform_matrix");
  const std::array<double, 12>& m = motion.rows;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double sign = axis == 0 ? 1.0 : -1.0;
    double offset = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      camera.rotation[3 * axis + k] = sign * m[4 * k + axis];
      offset -= sign * m[4 * k + axis] * m[4 * k + 3];
    }
    camera.translation[axis] = offset;
  }
  return motion.settled;
}

void set_world_to_camera(Camera& camera, const Node& frame) {
  const std::array<double, 12> m = read_matrix(frame, "world_to_camera").rows;
  for (std::size_t r = 0; r < 3; ++r) {
    for (std::size_t c = 0; c < 3; ++c) camera.rotation[3 * r + c] = m[4 * r + c];
    camera.translation[r] = m[4 * r + 3];
  }
}

std::optional<double> lookup(const Node& frame, const Node& file, const char* key) {
  if (frame.has(key)) return frame.number(key);
  if (file.has(key)) return file.number(key);
  return std::nullopt;
}

std::optional<ImageSize> stated_size(const Node& frame, const Node& file, const fs::path& image,
                                     const char* width_key, const char* height_key) {
  const auto width = lookup(frame, file, width_key), height = lookup(frame, file, height_key);
  if (width.has_value() != height.has_value())
    fail(ErrorKind::data, "{}: '{}' is given without '{}': give both or neither", frame.where,
         width ? width_key : height_key, width ? height_key : width_key);
  if (!width) return std::nullopt;
  if ((*width != std::floor(*width) || *height != std::floor(*height)) && path_exists(image)) {
    const ImageSize size = image_file_size(image);
    if (std::abs(*width - size.width) < 1 && std::abs(*height - size.height) < 1) return size;
  }
  for (const auto& [key, value] : {std::pair{width_key, *width}, std::pair{height_key, *height}})
    if (!(value >= 1 && value <= kMaxPixelsAcross) || value != std::floor(value))
      fail(ErrorKind::data, "{}: '{}' = {} must be a whole number from 1 to {}", frame.where, key, value,
           kMaxPixelsAcross);
  return ImageSize{static_cast<int>(*width), static_cast<int>(*height)};
}

// See frames_json.hpp. If the JSON states a fractional size, quantities in pixels refer to this fractional
// size, and not to `stated`, which is a whole number.
void set_intrinsics(Camera& camera, const Node& frame, const Node& file, ImageSize stated, ImageSize actual) {
  const auto uncut = [&](const char* key, int whole) {
    const double value = lookup(frame, file, key).value_or(whole);
    return std::abs(value - whole) < 1 ? value : whole;
  };
  const double wide = uncut("w", stated.width), high = uncut("h", stated.height);
  const auto fx = focal_length(frame, file, "camera_angle_x", "fl_x", wide);
  if (!fx)
    fail(ErrorKind::data, "{}: neither the frame nor the file has 'camera_angle_x' or 'fl_x'", frame.where);
  const double fy = focal_length(frame, file, "camera_angle_y", "fl_y", high).value_or(*fx);
  const double scale_x = actual.width / wide, scale_y = actual.height / high;
  camera.width = actual.width;
  camera.height = actual.height;
  camera.fx = *fx * scale_x;
  camera.fy = fy * scale_y;
  camera.cx = lookup(frame, file, "cx").value_or(wide / 2) * scale_x;
  camera.cy = lookup(frame, file, "cy").value_or(high / 2) * scale_y;
}

std::string camera_model(const Node& frame, const Node& file) {
  for (const Node* node : {&frame, &file}) {
    if (node->has("camera_model")) return node->text("camera_model");
    if (node->has("is_fisheye")) return node->flag("is_fisheye") ? "OPENCV_FISHEYE" : "OPENCV";
  }
  return "OPENCV";
}

namespace {

// Returns the lens model with this name or alias, without regard to case.
const LensModel& json_lens_model(std::string name, const std::string& where) {
  std::ranges::transform(name, name.begin(),
                         [](char c) { return c >= 'a' && c <= 'z' ? static_cast<char>(c - 32) : c; });
  std::vector<std::string_view> known;
  for (const LensModel& model : lens_models()) {
    std::vector<std::string_view> names = words_of(model.json_aliases);
    names.insert(names.begin(), model.name);
    if (std::ranges::find(names, name) != names.end()) return model;
    known.insert(known.end(), names.begin(), names.end());
  }
  fail(ErrorKind::data,
       "{}: camera_model '{}' is not known: undistort the images to PINHOLE, or use one of {}", where,
       name.substr(0, 40), fmt::join(known, ", "));
}

// Throws if the object has a field of another program that changes how the pixels are to be read. ubs would
// ignore such a field.
void refuse_foreign_lens(const Node& node) {
  if (node.has("latlong") && node.flag("latlong"))
    fail(ErrorKind::data,
         "{}: 'latlong' of instant-ngp is not supported: if the images cover 360 by 180 degrees, replace it "
         "by \"camera_model\": \"EQUIRECTANGULAR\"",
         node.where);
  for (const char* key : {"ftheta_p0", "ftheta_p1", "ftheta_p2", "ftheta_p3", "ftheta_p4"})
    if (node.has(key))
      fail(ErrorKind::data,
           "{}: '{}': the F-theta lens of instant-ngp is not supported: undistort the images to PINHOLE",
           node.where, key);
  if (!node.has("rolling_shutter")) return;
  const Json& shutter = node.json["rolling_shutter"];
  if (!shutter.is_array() || !std::ranges::all_of(shutter, [](const Json& v) { return v.is_number(); }))
    fail(ErrorKind::data, "{}: 'rolling_shutter' must be an array of numbers", node.where);
  if (std::ranges::any_of(shutter, [](const Json& v) { return v.get<double>() != 0; }))
    fail(ErrorKind::data,
         "{}: 'rolling_shutter' is not supported: correct the images, or set all of its values to 0 to use "
         "one "
         "pose for each image",
         node.where);
}

}  // namespace

Lens read_lens(const Node& frame, const Node& file, ImageSize size) {
  for (const Node* node : {&frame, &file}) refuse_foreign_lens(*node);
  const LensModel& model = json_lens_model(camera_model(frame, file), frame.where);
  Lens lens{model.formula, 1, 1, 0, 0, size.width, size.height, {}};
  std::vector<std::string_view> names = words_of(model.parameters);
  if (std::ranges::find(names, "w") != names.end()) {
    // The model is EQUIRECTANGULAR, for which focal lengths in the file have no meaning.
    lens.set("w", size.width), lens.set("h", size.height);
  } else {
    Camera camera;
    set_intrinsics(camera, frame, file, size, size);
    lens.fx = camera.fx, lens.fy = camera.fy, lens.cx = camera.cx, lens.cy = camera.cy;
  }
  for (const std::string_view extra : words_of(model.json_extra)) names.push_back(extra);
  for (const std::string_view coefficient : words_of(model.formula->coefficients))
    if (std::ranges::find(names, coefficient) != names.end())
      lens.set(coefficient, lookup(frame, file, std::string(coefficient).c_str()).value_or(0.0));
  // A coefficient that the lens model does not have would be silently ignored, so it is an error.
  for (const char* key : {"k", "k0", "k1", "k2", "k3", "k4", "k5", "k6", "p0", "p1", "p2", "s0", "s1", "s2",
                          "s3", "sx1", "sy1", "omega", "skew"})
    if (const double value = lookup(frame, file, key).value_or(0.0);
        value != 0 && std::ranges::find(names, key) == names.end())
      fail(ErrorKind::data,
           "{}: '{}' = {} is not a coefficient of the camera model {}: undistort the images first",
           frame.where, key, value, model.name);
  check_lens(lens, frame.where);
  return lens;
}

fs::path shown_name(const fs::path& found, const std::string& stated) {
  if (!found.empty()) return found;
  const std::vector<std::string> parts = path_components(stated);
  return parts.empty() ? fs::path(stated) : fs::path(parts.back());
}

std::string frame_name(const std::string& file_path) {
  const fs::path path(file_path);
  return (has_image_extension(path) ? path.stem() : path.filename()).string();
}

}  // namespace ubs::frames
