// SPDX-License-Identifier: Apache-2.0
// load_polycam() and load_record3d() load the recordings of phones: the raw data of Polycam, and unpacked
// recordings of Record3D. Poses of both are those of ARKit: camera-to-world with y up and z backward.
// NeRFCapture writes a transforms.json, which load_nerfstudio() reads.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/base/paths.hpp"
#include "host/dataset/data_root.hpp"
#include "host/dataset/frames_json.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/dataset/stated_views.hpp"
#include "host/formats/other_programs.hpp"
#include "host/scene/pose.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using frames::Node;

// Polycam optimises the poses after a recording. The optimised cameras belong to the corrected images.
constexpr std::array<std::array<const char*, 2>, 2> kPolycam{
    {{"corrected_cameras", "corrected_images"}, {"cameras", "images"}}};

struct PolycamFolder {
  std::string cameras, images;  // relative to the data folder; empty if there are none
};

PolycamFolder polycam_folder(const fs::path& path) {
  for (const fs::path& top : {fs::path("keyframes"), fs::path()})
    for (const auto& [cameras, images] : kPolycam) {
      const std::vector<fs::path> files = matching_paths(path / top / cameras, "*.json");
      if (!files.empty() && start_of_file(files[0]).find("\"t_00\"") != std::string::npos)
        return {(top / cameras).string(), (top / images).string()};
    }
  return {};
}

StatedView polycam_view(const fs::path& file) {
  const Json json = parse_json(read_text_file(file), file.string());
  const Node node{json, file.string()};
  if (!json.is_object()) fail(ErrorKind::data, "{}: the top level must be an object", node.where);
  const auto value = [&](const std::string& key) {
    if (!node.has(key.c_str())) fail(ErrorKind::data, "{}: '{}' is missing", node.where, key);
    return node.number(key.c_str());
  };
  const auto size = frames::stated_size(node, node, {}, "width", "height");
  if (!size) fail(ErrorKind::data, "{}: 'width' and 'height' are missing", node.where);
  const Lens lens = make_lens("PINHOLE", *size, value("fx"), value("fy"), value("cx"), value("cy"));
  std::array<double, 9> rotation{};
  std::array<double, 3> position{};
  for (std::size_t r = 0; r < 3; ++r) {
    for (std::size_t c = 0; c < 3; ++c) rotation[3 * r + c] = value(fmt::format("t_{}{}", r, c));
    position[r] = value(fmt::format("t_{}3", r));
  }
  return {{file.stem().string(), node.where},
          pose_from_world(rotation, position, CameraAxes::y_up_z_backward, node.where),
          size,
          [lens](ImageSize) { return lens; }};
}

// The file has no extension in a recording, and .json in an export.
fs::path record3d_file(const fs::path& path) {
  for (const char* name : {"metadata", "metadata.json"})
    if (const std::string start = start_of_file(path / name);
        start.find("\"poses\"") != std::string::npos && start.find("\"K\"") != std::string::npos)
      return path / name;
  return {};
}

}  // namespace

std::vector<std::string> polycam_files(const fs::path& path) {
  const std::string cameras = is_folder(path) ? polycam_folder(path).cameras : "";
  return cameras.empty() ? std::vector<std::string>{} : std::vector{cameras + "/*.json"};
}

LoadedScene load_polycam(const fs::path& folder, const DatasetOptions& options) {
  LoadedScene scene;
  DataRoot root(folder, options.read.allow_outside);
  const PolycamFolder of = polycam_folder(folder);
  if (of.cameras.empty())
    fail(ErrorKind::data, "{}: contains no raw data of Polycam (keyframes/cameras/*.json)", folder.string());
  std::vector<StatedView> stated;
  for (const fs::path& file : matching_paths(folder / of.cameras, "*.json"))
    stated.push_back(polycam_view(root.check(file)));
  const ImageFolder images = find_image_folder(folder, options, root, stated[0].image.name, {of.images});
  add_stated_views(scene, folder, images, stated, root, options);
  return scene;
}

std::vector<std::string> record3d_files(const fs::path& path) {
  const fs::path file = is_folder(path) ? record3d_file(path) : fs::path();
  return file.empty() ? std::vector<std::string>{} : std::vector{file.filename().string()};
}

// The matrix "K" is stored by columns. Each pose is a quaternion x y z w and a position.
LoadedScene load_record3d(const fs::path& folder, const DatasetOptions& options) {
  LoadedScene scene;
  DataRoot root(folder, options.read.allow_outside);
  const fs::path file = record3d_file(folder);
  if (file.empty()) fail(ErrorKind::data, "{}: contains no metadata of Record3D", folder.string());
  const Json json = parse_json(read_text_file(root.check(file)), file.string());
  const Node node{json, file.string()};
  if (!json.is_object() || !node.has("poses") || !json["poses"].is_array() || json["poses"].empty())
    fail(ErrorKind::data, "{}: 'poses' must be a non-empty array", node.where);
  const auto numbers = [](const Json& values, std::size_t count, const std::string& where) {
    std::vector<double> result;
    if (values.is_array())
      for (const Json& value : values)
        if (value.is_number()) result.push_back(checked_input(value.get<double>(), where));
    if (result.size() != count || values.size() != count)
      fail(ErrorKind::data, "{}: must be {} numbers", where, count);
    return result;
  };
  const auto size = frames::stated_size(node, node, {});
  if (!size) fail(ErrorKind::data, "{}: 'w' and 'h' are missing", node.where);
  const std::vector<double> k = numbers(node.has("K") ? json["K"] : Json(), 9, node.where + ": 'K'");
  const Json* intrinsics = node.has("perFrameIntrinsicCoeffs") ? &json["perFrameIntrinsicCoeffs"] : nullptr;
  if (intrinsics && intrinsics->size() != json["poses"].size()) intrinsics = nullptr;
  std::vector<StatedView> stated;
  for (std::size_t i = 0; i < json["poses"].size(); ++i) {
    const std::string where = fmt::format("{}: pose {}", file.string(), i);
    const std::vector<double> p = numbers(json["poses"][i], 7, where);
    const double length = std::sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2] + p[3] * p[3]);
    if (!(length > 1e-6)) fail(ErrorKind::data, "{}: the quaternion is zero", where);
    const std::array<double, 9> rotation =
        matrix(Quaternion{p[3] / length, p[0] / length, p[1] / length, p[2] / length});
    // fx fy cx cy
    std::vector<double> f{k[0], k[4], k[6], k[7]};
    if (intrinsics) f = numbers((*intrinsics)[i], 4, where + ": 'perFrameIntrinsicCoeffs'");
    const Lens lens = make_lens("PINHOLE", *size, f[0], f[1], f[2], f[3]);
    stated.push_back({{std::to_string(i), where},
                      pose_from_world(rotation, {p[4], p[5], p[6]}, CameraAxes::y_up_z_backward, where),
                      size,
                      [lens](ImageSize) { return lens; }});
  }
  ImageFolder images = find_image_folder(folder, options, root, stated[0].image.name + ".jpg",
                                         {"rgb", "rgbd", "images", "EXR_RGBD/rgb"});
  // In an export, the numbers in the names may have leading zeros.
  if (const std::vector<fs::path> files = pictures_in(images.path); files.size() == stated.size())
    if (!path_exists(images.path / (stated[0].image.name + ".jpg")))
      for (std::size_t i = 0; i < files.size(); ++i) stated[i].image.name = files[i].filename().string();
  add_stated_views(scene, folder, images, stated, root, options);
  return scene;
}

}  // namespace ubs
