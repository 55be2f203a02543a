// SPDX-License-Identifier: Apache-2.0
// nerfstudio folders: one transforms.json with lens parameters per file or frame, masks, and the file of
// points that ply_file_path names. Poses are used as they stand (applied_transform is already in them).
#include <algorithm>
#include <set>

#include "host/base/paths.hpp"
#include "host/data/data_root.hpp"
#include "host/data/frames_json.hpp"
#include "host/data/load_dataset.hpp"
#include "host/data/view_image.hpp"
#include "host/data/view_names.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using namespace frames;

// instant-ngp writes is_fisheye in the place of a name.
std::string camera_model(const Node& frame, const Node& file) {
  for (const Node* node : {&frame, &file}) {
    if (node->has("camera_model")) return node->text("camera_model");
    if (!node->has("is_fisheye")) continue;
    const Json& fisheye = node->json["is_fisheye"];
    if (!fisheye.is_boolean()) fail(ErrorKind::data, "{}: 'is_fisheye' must be true or false", node->where);
    return fisheye.get<bool>() ? "OPENCV_FISHEYE" : "OPENCV";
  }
  return "OPENCV";
}

Lens read_lens(const Node& frame, const Node& file, ImageSize size) {
  Camera camera;
  set_intrinsics(camera, frame, file, size, size);
  Lens lens{LensModel::opencv, camera.fx, camera.fy, camera.cx, camera.cy, size.width, size.height, {}};
  const std::string model = camera_model(frame, file);
  const auto value = [&](const char* key) { return lookup(frame, file, key).value_or(0.0); };
  static const std::set<std::string> kPlain{"OPENCV",        "PINHOLE", "SIMPLE_PINHOLE",
                                            "SIMPLE_RADIAL", "RADIAL",  "PERSPECTIVE"};
  if (model == "OPENCV_FISHEYE" || model == "FISHEYE") {
    lens.model = LensModel::opencv_fisheye;
    lens.k = {value("k1"), value("k2"), value("k3"), value("k4")};
  } else if (kPlain.contains(model)) {
    if (value("k4") != 0)
      fail(ErrorKind::data, "{}: 'k4' has no agreed meaning for {}: undistort the images first", frame.where,
           model);
    lens.k = {value("k1"), value("k2"), value("p1"), value("p2"), value("k3")};
  } else {
    fail(ErrorKind::data, "{}: camera_model '{}' is not supported: use OPENCV, OPENCV_FISHEYE or PINHOLE",
         frame.where, model.substr(0, 40));
  }
  return lens;
}

// The lists train_filenames, val_filenames, test_filenames, where the file has them.
std::optional<std::set<std::string>> name_list(const Node& file, const char* key) {
  if (!file.has(key)) return std::nullopt;
  const Json& list = file.json[key];
  std::set<std::string> names;
  if (!list.is_array()) fail(ErrorKind::data, "{}: '{}' must be an array of strings", file.where, key);
  for (const Json& name : list) {
    if (!name.is_string()) fail(ErrorKind::data, "{}: '{}' must be an array of strings", file.where, key);
    names.insert(fs::path(name.get<std::string>()).lexically_normal().string());
  }
  return names;
}

struct NamedView {
  View view;
  std::string file_path;
};

std::vector<Split> make_splits(std::vector<NamedView> named, const Node& file, const DatasetOptions& options,
                               LoadReport& report) {
  using Names = std::optional<std::set<std::string>>;
  std::pair<const char*, Names> lists[] = {{"train", name_list(file, "train_filenames")},
                                           {"val", name_list(file, "val_filenames")},
                                           {"test", name_list(file, "test_filenames")}};
  const auto listed = [&](const NamedView& n) {
    return std::ranges::any_of(lists,
                               [&](const auto& l) { return l.second && l.second->contains(n.file_path); });
  };
  std::vector<View> views;
  if (std::ranges::none_of(lists, [](const auto& list) { return list.second.has_value(); })) {
    for (NamedView& n : named) views.push_back(std::move(n.view));
    return split_every(std::move(views), options.read.test_every);
  }
  if (!lists[0].second) {
    std::set<std::string> rest;
    for (const NamedView& n : named)
      if (!listed(n)) rest.insert(n.file_path);
    lists[0].second = std::move(rest);
    report.note("no train_filenames in the file: what its other lists leave is learnt from");
  }
  std::vector<Split> splits;
  for (const auto& [split, names] : lists) {
    if (!names) continue;
    Split result{split, {}};
    for (const NamedView& n : named)
      if (names->contains(n.file_path)) result.views.push_back(n.view);
    if (!result.views.empty()) splits.push_back(std::move(result));
  }
  for (const NamedView& n : named)
    if (!listed(n)) report.skip(n.file_path, "in none of the lists of file names");
  report.note("splits as listed in the file");
  return splits;
}

ImageSize size_of(const Node& frame, const Node& file, const fs::path& image) {
  if (const auto stated = stated_size(frame, file, image)) return *stated;
  if (!path_exists(image))
    fail(ErrorKind::data, "{}: image {} does not exist, and the JSON has no 'w' and 'h'", frame.where,
         image.string());
  return image_file_size(image);
}

}  // namespace

LoadedScene load_nerfstudio(const fs::path& path, const DatasetOptions& options) {
  const fs::path json_path = is_folder(path) ? path / "transforms.json" : path;
  const fs::path folder = json_path.parent_path();
  const DataRoot root(path, options.read.allow_outside);
  const Json json = parse_file(json_path == path ? path : root.check(json_path));
  const Node file{json, json_path.string()};
  LoadedScene scene;
  std::vector<NamedView> named;
  std::set<std::string> missing;
  std::size_t masks = 0;
  double low = 0, high = 0;
  for (std::size_t i = 0; i < json["frames"].size(); ++i) {
    const Node frame = frame_node(json, i, json_path.string());
    const std::string file_path = frame.text("file_path");
    const fs::path image = root.check(image_path(folder, file_path), frame.where);
    NamedView n{{}, fs::path(file_path).lexically_normal().string()};
    n.view.name = view_name(image.filename());
    set_pose(n.view.camera, frame);
    const double time = frame.has("time") ? frame.number("time") : 0.0;
    low = named.empty() ? time : std::min(low, time);
    high = named.empty() ? time : std::max(high, time);
    n.view.camera.time = time;
    fs::path mask;
    if (frame.has("mask_path")) mask = (folder / frame.text("mask_path")).lexically_normal();
    if (!mask.empty() && !path_exists(mask))
      fail(ErrorKind::data, "{}: mask {} does not exist", frame.where, mask.string());
    if (!mask.empty()) root.check(mask, frame.where);
    masks += !mask.empty();
    const bool found = attach_image(n.view, read_lens(frame, file, size_of(frame, file, image)), image, mask,
                                    options, scene.report);
    check_camera(n.view.camera, frame.where);
    if (!found) missing.insert(n.file_path);
    named.push_back(std::move(n));
  }
  if (options.load_images || missing.size() < named.size())  // else a file of cameras alone
    std::erase_if(named, [&](const NamedView& n) {
      if (missing.contains(n.file_path)) scene.report.skip(n.file_path, "no such image");
      return missing.contains(n.file_path);
    });
  if (named.empty()) fail(ErrorKind::data, "{}: none of the images exists", json_path.string());
  std::vector<View> unique;
  for (NamedView& n : named) unique.push_back(std::move(n.view));
  settle_view_names(unique);
  for (std::size_t i = 0; i < named.size(); ++i) {
    named[i].view = std::move(unique[i]);
    double& time = named[i].view.camera.time;
    time = high > low ? (time - low) / (high - low) : 0.0;
  }
  if (masks > 0) scene.report.note(fmt::format("{} masks: masked pixels do not count", masks));
  if (file.has("ply_file_path")) {
    const fs::path points = folder / file.text("ply_file_path");
    if (path_exists(points))
      scene.points = read_world_points(root.check(points, json_path.string()));
    else
      scene.report.skip(points.string(), "ply_file_path names no file");
  }
  scene.splits = make_splits(std::move(named), file, options, scene.report);
  if (scene.splits.empty())
    fail(ErrorKind::data, "{}: the lists of file names match no frame", json_path.string());
  return scene;
}

}  // namespace ubs
