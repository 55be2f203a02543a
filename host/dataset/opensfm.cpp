// SPDX-License-Identifier: Apache-2.0
// load_opensfm() loads reconstruction.json of OpenSfM and ODM. Lengths in the image are in units of the
// larger of its width and height, and the origin is the centre of the image. Poses are world-to-camera with z
// forward; rotations are vectors whose length is the angle.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
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

namespace ubs {
namespace {

namespace fs = std::filesystem;
using frames::Node;

const Json& opensfm_member(const Node& node, const char* key, Json::value_t type) {
  if (!node.has(key) || node.json[key].type() != type)
    fail(ErrorKind::data, "{}: '{}' is missing or of another type", node.where, key);
  return node.json[key];
}

// A projection of OpenSfM and the lens model with the same formula. `coefficients` are the names in OpenSfM,
// and `ours` those of the lens model, in the same order.
struct Projection {
  std::string_view name, model, coefficients, ours;
};
constexpr Projection kProjections[] = {
    {"perspective", "BROWN", "k1 k2", "k1 k2"},
    {"simple_radial", "BROWN", "k1", "k1"},
    {"radial", "BROWN", "k1 k2", "k1 k2"},
    {"brown", "BROWN", "k1 k2 k3 p1 p2", "k1 k2 k3 p1 p2"},
    {"fisheye", "OPENCV_FISHEYE", "k1 k2", "k1 k2"},
    {"fisheye_opencv", "OPENCV_FISHEYE", "k1 k2 k3 k4", "k1 k2 k3 k4"},
    {"fisheye62", "RAD_TAN_THIN_PRISM_FISHEYE", "k1 k2 k3 k4 k5 k6 p1 p2", "k0 k1 k2 k3 k4 k5 p0 p1"},
    {"fisheye624", "RAD_TAN_THIN_PRISM_FISHEYE", "k1 k2 k3 k4 k5 k6 p1 p2 s0 s1 s2 s3",
     "k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3"},
    {"spherical", "EQUIRECTANGULAR", "", ""},
    {"equirectangular", "EQUIRECTANGULAR", "", ""},
};

Lens opensfm_lens(const Node& camera, ImageSize size) {
  const std::string type = camera.text("projection_type");
  const auto row = std::ranges::find(kProjections, type, &Projection::name);
  if (row == std::end(kProjections))
    fail(ErrorKind::data,
         "{}: the projection '{}' is not supported: undistort the images with 'opensfm undistort' and pass "
         "the "
         "folder 'undistorted'",
         camera.where, type.substr(0, 40));
  if (row->model == "EQUIRECTANGULAR") {
    Lens lens = make_lens(row->model, size, 1, 1, 0, 0);
    lens.set("w", size.width), lens.set("h", size.height);
    return lens;
  }
  const double larger = std::max(size.width, size.height);
  const auto value = [&](const std::string& key, double otherwise) {
    return camera.has(key.c_str()) ? camera.number(key.c_str()) : otherwise;
  };
  const double focal = value("focal", 0), fx = value("focal_x", focal), fy = value("focal_y", fx);
  Lens lens =
      make_lens(row->model, size, fx * larger, fy * larger, size.width / 2.0 + value("c_x", 0) * larger,
                size.height / 2.0 + value("c_y", 0) * larger);
  const auto theirs = words_of(row->coefficients), ours = words_of(row->ours);
  for (std::size_t i = 0; i < theirs.size(); ++i) lens.set(ours[i], value(std::string(theirs[i]), 0));
  check_lens(lens, camera.where);
  return lens;
}

// Returns the matrix of the rotation about the axis `v` by the angle |v| (Rodrigues' formula).
std::array<double, 9> rotation_about(const std::array<double, 3>& v) {
  const double angle = std::hypot(v[0], v[1], v[2]);
  const double a = angle > 1e-8 ? std::sin(angle) / angle : 1;
  const double b = angle > 1e-8 ? (1 - std::cos(angle)) / (angle * angle) : 0.5;
  const auto [x, y, z] = v;
  const double c = std::cos(angle);
  return {c + b * x * x,     b * x * y - a * z, b * x * z + a * y, b * x * y + a * z, c + b * y * y,
          b * y * z - a * x, b * x * z - a * y, b * y * z + a * x, c + b * z * z};
}

fs::path find_reconstruction(const fs::path& path) {
  if (is_regular(path))
    return start_of_file(path).find("\"projection_type\"") == std::string::npos ? fs::path() : path;
  for (const char* name : {"reconstruction.json", "opensfm/reconstruction.json"})
    if (path_exists(path / name)) return path / name;
  return {};
}

void take_opensfm_points(const Node& part, LoadedScene& scene) {
  if (!part.has("points") || !part.json["points"].is_object()) return;
  scene.points.emplace();
  for (const auto& [name, point] : part.json["points"].items()) {
    const Node node{point, fmt::format("{}: point {}", part.where, name)};
    if (!point.is_object()) fail(ErrorKind::data, "{}: must be an object", node.where);
    std::array<std::uint8_t, 3> colour{127, 127, 127};
    if (node.has("color")) {
      const std::array<double, 3> values = node.vector("color");
      for (std::size_t k = 0; k < 3; ++k)
        colour[k] = static_cast<std::uint8_t>(std::lround(std::clamp(values[k], 0.0, 255.0)));
    }
    add_point(*scene.points, node.vector("coordinates"), colour, scene.points->positions.size(), node.where);
  }
}

}  // namespace

std::vector<std::string> opensfm_files(const fs::path& path) {
  const fs::path file = find_reconstruction(path);
  if (file.empty()) return {};
  return {is_regular(path) ? file.string() : file.lexically_relative(path).string()};
}

LoadedScene load_opensfm(const fs::path& path, const DatasetOptions& options) {
  LoadedScene scene;
  DataRoot root(path, options.read.allow_outside);
  const fs::path file = find_reconstruction(path);
  if (file.empty()) fail(ErrorKind::data, "{}: contains no reconstruction.json of OpenSfM", path.string());
  const Json json = parse_json(read_text_file(root.check(file)), file.string());
  if (!json.is_array() || json.empty())
    fail(ErrorKind::data, "{}: the top level must be an array of reconstructions", file.string());
  const auto count = [](const Json& part) {
    return part.is_object() && part.contains("shots") ? part["shots"].size() : 0;
  };
  std::size_t used = 0;
  for (std::size_t i = 1; i < json.size(); ++i)
    if (count(json[i]) > count(json[used])) used = i;
  if (json.size() > 1)
    scene.report.note_difference(fmt::format(
        "{} reconstructions, which are not connected: only number {}, the largest ({} images), is used",
        json.size(), used, count(json[used])));
  const Node part{json[used], fmt::format("{}: reconstruction {}", file.string(), used)};
  if (count(json[used]) == 0) fail(ErrorKind::data, "{}: there are no images in 'shots'", part.where);
  const Json& cameras = opensfm_member(part, "cameras", Json::value_t::object);
  std::map<std::string, const Json*> cameras_by_name;
  for (const auto& [name, camera] : cameras.items()) cameras_by_name[name] = &camera;
  std::vector<StatedView> stated;
  for (const auto& [name, shot] : opensfm_member(part, "shots", Json::value_t::object).items()) {
    const Node node{shot, fmt::format("{}: shot '{}'", file.string(), name)};
    if (!shot.is_object()) fail(ErrorKind::data, "{}: must be an object", node.where);
    const auto camera = cameras_by_name.find(node.text("camera"));
    if (camera == cameras_by_name.end() || !camera->second->is_object())
      fail(ErrorKind::data, "{}: there is no camera '{}'", node.where, node.text("camera").substr(0, 80));
    const Node of{*camera->second, fmt::format("{}: camera '{}'", file.string(), camera->first)};
    const auto size = frames::stated_size(of, of, {}, "width", "height");
    if (!size) fail(ErrorKind::data, "{}: 'width' and 'height' are missing", of.where);
    const Lens lens = opensfm_lens(of, *size);
    stated.push_back({{name, node.where},
                      pose_from_camera(rotation_about(node.vector("rotation")), node.vector("translation"),
                                       CameraAxes::y_down_z_forward, node.where),
                      size,
                      [lens](ImageSize) { return lens; }});
  }
  take_opensfm_points(part, scene);
  const fs::path folder = is_folder(path) ? path : path.parent_path();
  const ImageFolder images = find_image_folder(folder, options, root, stated[0].image.name, {"images", "."});
  add_stated_views(scene, folder, images, stated, root, options);
  return scene;
}

}  // namespace ubs
