// SPDX-License-Identifier: Apache-2.0
// load_nerfstudio() loads nerfstudio folders. Their file transforms.json contains lens parameters, which are
// stated once for the file or separately for each frame, and the paths of the images, of the masks and of a
// point cloud (ply_file_path). applied_transform is not used, because the poses already include it.
#include <fmt/ranges.h>

#include <algorithm>
#include <set>

#include "host/base/paths.hpp"
#include "host/data/data_root.hpp"
#include "host/data/frames_json.hpp"
#include "host/data/load_dataset.hpp"
#include "host/data/name_index.hpp"
#include "host/data/named_files.hpp"
#include "host/data/split_views.hpp"
#include "host/data/view_image.hpp"
#include "host/data/view_names.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using namespace frames;

// Returns the name of the camera model. instant-ngp writes is_fisheye instead of a name. The model is OPENCV
// if the JSON has neither.
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

Lens read_lens(const Node& frame, const Node& file, ImageSize size) {
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
  for (const char* key : {"k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"})
    if (const double value = lookup(frame, file, key).value_or(0.0);
        value != 0 && std::ranges::find(names, key) == names.end())
      fail(ErrorKind::data,
           "{}: '{}' = {} is not a coefficient of the camera model {}: undistort the images first",
           frame.where, key, value, model.name);
  check_lens(lens, frame.where);
  return lens;
}

struct NamedView {
  View view;
  std::string file_path;
};

// Returns the paths of the frames that are in a list (train_filenames, val_filenames or test_filenames), or
// nullopt if the file does not have this list. A name in the list may differ from the path of the frame in
// the ways that name_index.hpp describes.
std::optional<std::set<std::string>> name_list(const Node& file, const char* key,
                                               const std::vector<NamedView>& named, LoadReport& report) {
  if (!file.has(key)) return std::nullopt;
  const Json& list = file.json[key];
  if (!list.is_array()) fail(ErrorKind::data, "{}: '{}' must be an array of strings", file.where, key);
  std::set<std::string> stated, names;
  for (const NamedView& n : named) stated.insert(n.file_path);
  NameIndex index;
  for (const std::string& path : stated) index.add(path);
  std::size_t others = 0;
  for (const Json& name : list) {
    if (!name.is_string()) fail(ErrorKind::data, "{}: '{}' must be an array of strings", file.where, key);
    const std::string path = fs::path(name.get<std::string>()).lexically_normal().string();
    if (stated.contains(path)) {
      names.insert(path);
    } else if (const auto match = index.find(path, [](std::size_t) { return true; })) {
      names.insert(index.path(match->number));
      ++others;
    } else {
      report.skip(path, fmt::format("listed in '{}', but no frame with an image has this name", key));
    }
  }
  if (others > 0)
    report.note_difference(fmt::format("{} names of '{}' match a file only approximately", others, key));
  return names;
}

std::vector<Split> make_splits(std::vector<NamedView> named, const Node& file, const DatasetOptions& options,
                               LoadReport& report) {
  using Names = std::optional<std::set<std::string>>;
  std::pair<const char*, Names> lists[] = {{"train", name_list(file, "train_filenames", named, report)},
                                           {"val", name_list(file, "val_filenames", named, report)},
                                           {"test", name_list(file, "test_filenames", named, report)}};
  const auto listed = [&](const NamedView& n) {
    return std::ranges::any_of(lists,
                               [&](const auto& l) { return l.second && l.second->contains(n.file_path); });
  };
  std::vector<View> views;
  if (std::ranges::none_of(lists, [](const auto& list) { return list.second.has_value(); })) {
    for (NamedView& n : named) views.push_back(std::move(n.view));
    return split_views(std::move(views), options.read.test_every, report);
  }
  if (!lists[0].second) {
    std::set<std::string> rest;
    for (const NamedView& n : named)
      if (!listed(n)) rest.insert(n.file_path);
    lists[0].second = std::move(rest);
    report.note(
        "the file has no train_filenames: all images that are not in its other lists are used for training");
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
    if (!listed(n)) report.skip(n.file_path, "it is in none of the lists of file names");
  report.note("using the splits that are listed in the file");
  return splits;
}

// Returns the size that the JSON states, or the size of the image file. Returns nullopt if there is neither.
std::optional<ImageSize> size_of(const Node& frame, const Node& file, const fs::path& image) {
  if (const auto stated = stated_size(frame, file, image)) return stated;
  return image.empty() ? std::nullopt : std::optional(image_file_size(image));
}

// Returns, for each frame, the file whose name is in the field `key` of the frame. The path is empty if the
// frame has no such field, or if the file does not exist.
std::vector<fs::path> files_of(NamedFiles& files, const std::vector<Node>& frames, const char* key,
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

}  // namespace

LoadedScene load_nerfstudio(const fs::path& path, const DatasetOptions& options) {
  const fs::path json_path = is_folder(path) ? path / "transforms.json" : path;
  const fs::path folder = json_path.parent_path();
  const DataRoot root(path, options.read.allow_outside);
  const Json json = parse_file(json_path == path ? path : root.check(json_path));
  const Node file{json, json_path.string()};
  std::vector<Node> frames;
  for (std::size_t i = 0; i < json["frames"].size(); ++i) {
    frames.push_back(frame_node(json, i, json_path.string()));
    frames.back().text("file_path");
  }
  NamedFiles files(root, folder);
  const std::vector<fs::path> images = files_of(files, frames, "file_path", folder, NamedFiles::Kind::image);
  const std::vector<fs::path> mask_files =
      files_of(files, frames, "mask_path", folder, NamedFiles::Kind::mask);
  const auto image_of = [](const Node& frame) { return frame.text("file_path"); };
  const bool some = std::ranges::any_of(images, [](const fs::path& image) { return !image.empty(); });
  if (options.load_images && !some)
    fail(ErrorKind::data,
         "{}: none of the {} images exists: for example, {}; copy the images there or correct 'file_path'",
         json_path.string(), frames.size(), files.missing(folder, image_of(frames[0])));
  LoadedScene scene;
  std::vector<NamedView> named;
  std::vector<View> unique;
  std::vector<std::size_t> counts;  // number of views of each frame
  std::size_t masks = 0;
  double low = 0, high = 0;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const Node& frame = frames[i];
    const fs::path& image = images[i];
    if (image.empty() && some) {  // if no image exists at all, the cameras are loaded without images
      scene.report.skip(image_of(frame), "the image does not exist");
      continue;
    }
    NamedView n{{}, fs::path(image_of(frame)).lexically_normal().string()};
    n.view.name = view_name(shown_name(image, image_of(frame)).filename());
    set_pose(n.view.camera, frame);
    const double time = frame.has("time") ? frame.number("time") : 0.0;
    low = named.empty() ? time : std::min(low, time);
    high = named.empty() ? time : std::max(high, time);
    n.view.camera.time = time;
    const fs::path& mask = mask_files[i];
    if (mask.empty() && frame.has("mask_path") && some)
      fail(ErrorKind::data, "{}: the mask {}; copy the masks there or correct 'mask_path'", frame.where,
           files.missing(folder, frame.text("mask_path")));
    masks += !mask.empty();
    const auto size = size_of(frame, file, image);
    if (!size)
      fail(ErrorKind::data, "{}: the image {}, and the JSON has no 'w' and 'h'", frame.where,
           files.missing(folder, image_of(frame)));
    counts.push_back(
        append_views(unique, n.view, read_lens(frame, file, *size), image, mask, options, scene.report));
    for (std::size_t k = unique.size() - counts.back(); k < unique.size(); ++k) {
      check_camera(unique[k].camera, frame.where);
      named.push_back(n);
    }
  }
  settle_image_names(unique, counts);
  for (std::size_t i = 0; i < named.size(); ++i) {
    named[i].view = std::move(unique[i]);
    double& time = named[i].view.camera.time;
    time = high > low ? (time - low) / (high - low) : 0.0;
  }
  if (masks > 0) scene.report.note(fmt::format("{} masks: masked pixels are ignored", masks));
  if (file.has("ply_file_path")) {
    const std::string name = file.text("ply_file_path");
    const fs::path points = files.find(folder, {{name, file.where}}, NamedFiles::Kind::points).front();
    if (points.empty())
      scene.report.note_difference(fmt::format("no points: 'ply_file_path' {}", files.missing(folder, name)));
    else
      take_points(points, scene);
  }
  files.report(scene.report);
  scene.splits = make_splits(std::move(named), file, options, scene.report);
  if (scene.splits.empty())
    fail(ErrorKind::data, "{}: the lists of file names match no frame", json_path.string());
  return scene;
}

}  // namespace ubs
