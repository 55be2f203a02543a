// SPDX-License-Identifier: Apache-2.0
// load_nerfstudio() loads nerfstudio folders. Their file transforms.json contains lens parameters, which are
// stated once for the file or separately for each frame, and the paths of the images, of the masks and of a
// point cloud (ply_file_path). applied_transform is not used, because the poses already include it.
#include <fmt/ranges.h>

#include <algorithm>
#include <set>

#include "host/base/paths.hpp"
#include "host/dataset/data_root.hpp"
#include "host/dataset/frames_json.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/dataset/name_index.hpp"
#include "host/dataset/named_files.hpp"
#include "host/dataset/split_views.hpp"
#include "host/dataset/view_image.hpp"
#include "host/dataset/view_names.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using namespace frames;

struct NamedView {
  View view;
  std::string file_path;
  bool test = false;  // from the list 'test_frames'
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

// ScanNet++ states the test views in a list of their own.
bool has_test_frames(const Node& file) {
  return file.has("test_frames") && !file.json["test_frames"].empty();
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
  const bool listed_names =
      std::ranges::any_of(lists, [](const auto& list) { return list.second.has_value(); });
  std::vector<View> views;
  if (has_test_frames(file)) {
    if (listed_names)
      fail(ErrorKind::data,
           "{}: there are both 'test_frames' and lists of file names, such as 'train_filenames': remove one "
           "of the two",
           file.where);
    std::vector<Split> splits{{"train", {}}, {"test", {}}};
    for (NamedView& n : named) splits[n.test].views.push_back(std::move(n.view));
    std::erase_if(splits, [](const Split& split) { return split.views.empty(); });
    report.note("the test views are those of the list 'test_frames'");
    return splits;
  }
  if (!listed_names) {
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

}  // namespace

LoadedScene load_nerfstudio(const fs::path& path, const DatasetOptions& options) {
  const fs::path json_path = is_folder(path) ? path / "transforms.json" : path;
  const fs::path folder = json_path.parent_path();
  DataRoot root(path, options.read.allow_outside);
  const Json json = parse_file(json_path == path ? path : root.check(json_path));
  const Node file{json, json_path.string()};
  std::vector<Node> frames = frame_nodes(json, file.where);
  const std::size_t count_of_frames = frames.size();  // without those of 'test_frames'
  if (has_test_frames(file)) {
    const std::vector<Node> test = frame_nodes(json, file.where, "test_frames");
    for (const Node& frame : test) frames.push_back(frame);
  }
  for (const Node& frame : frames) frame.text("file_path");
  check_times(frames);
  NamedFiles files(root, folder);
  std::vector<fs::path> images = stated_images(files, frames, folder, root, options);
  const std::vector<fs::path> mask_files =
      stated_files(files, frames, "mask_path", folder, NamedFiles::Kind::mask);
  std::size_t bad = 0;
  for (std::size_t i = 0; i < frames.size(); ++i)
    if (frames[i].flag("is_bad")) images[i].clear(), ++bad;
  if (bad == frames.size()) fail(ErrorKind::data, "{}: all frames have 'is_bad': true", file.where);
  const auto image_of = [](const Node& frame) { return frame.text("file_path"); };
  const bool some = std::ranges::any_of(images, [](const fs::path& image) { return !image.empty(); });
  if (options.load_images && !some)
    fail(ErrorKind::data, "{}: {}", json_path.string(), no_images(files, frames, folder, options));
  const std::size_t masks = count_masks(files, frames, images, mask_files, folder);
  LoadedScene scene;
  std::vector<NamedView> named;
  std::vector<View> unique;
  std::vector<std::size_t> counts;  // number of views of each frame
  std::size_t rounded_poses = 0;
  double low = 0, high = 0;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const Node& frame = frames[i];
    const fs::path& image = images[i];
    if (frame.flag("is_bad")) {
      scene.report.skip(image_of(frame), "the frame has 'is_bad': true");
      continue;
    }
    if (image.empty() && some) {  // if no image exists at all, the cameras are loaded without images
      scene.report.skip(image_of(frame), "the image does not exist");
      continue;
    }
    NamedView n{{}, fs::path(image_of(frame)).lexically_normal().string(), i >= count_of_frames};
    n.view.name = view_name(shown_name(image, image_of(frame)).filename());
    rounded_poses += set_pose(n.view.camera, frame);
    const double time = frame.has("time") ? frame.number("time") : 0.0;
    low = named.empty() ? time : std::min(low, time);
    high = named.empty() ? time : std::max(high, time);
    n.view.camera.time = time;
    const auto size = size_of(frame, file, image);
    if (!size)
      fail(ErrorKind::data, "{}: the image {}, and the JSON has no 'w' and 'h'", frame.where,
           files.missing(folder, image_of(frame)));
    counts.push_back(append_views(unique, n.view, read_lens(frame, file, *size), image, mask_files[i],
                                  options, scene.report));
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
  note_rounded_poses(rounded_poses, scene.report);
  if (file.has("fisheye_crop_radius"))
    scene.report.note_difference(
        "'fisheye_crop_radius' is not used: the pixels outside of this circle are used too, unless masks "
        "('mask_path') exclude them");
  take_stated_points(files, file, folder, scene);
  files.report(scene.report);
  scene.splits = make_splits(std::move(named), file, options, scene.report);
  if (scene.splits.empty())
    fail(ErrorKind::data, "{}: the lists of file names match no frame", json_path.string());
  note_shared_images(scene.splits, scene.report);
  return scene;
}

}  // namespace ubs
