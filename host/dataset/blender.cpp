// SPDX-License-Identifier: Apache-2.0
// See blender.hpp. The cameras are read first, one frame after the other, then the images in parallel.
#include "host/dataset/blender.hpp"

#include <algorithm>
#include <limits>
#include <list>

#include "host/base/error.hpp"
#include "host/base/parallel.hpp"
#include "host/base/paths.hpp"
#include "host/dataset/data_root.hpp"
#include "host/dataset/frames_json.hpp"
#include "host/dataset/image.hpp"
#include "host/dataset/image_info.hpp"
#include "host/dataset/image_source.hpp"
#include "host/dataset/named_files.hpp"
#include "host/dataset/view_image.hpp"
#include "host/dataset/view_names.hpp"

namespace ubs {

namespace {

namespace fs = std::filesystem;
using namespace frames;

fs::path transforms_path(const fs::path& folder, const std::string& split) {
  return folder / ("transforms_" + split + ".json");
}

double raw_time(const Node& frame) { return frame.has("time") ? frame.number("time") : 0.0; }

struct TimeRange {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  void add(double t) { low = std::min(low, t), high = std::max(high, t); }
  bool contains(double t) const { return t >= low && t <= high; }
  double normalise(double t) const { return high > low ? (t - low) / (high - low) : 0.0; }
};

std::vector<double> read_query(const Node& frame) {
  if (!frame.has("query")) return {};
  const Json& values = frame.json["query"];
  if (!values.is_array()) fail(ErrorKind::data, "{}: 'query' must be an array of numbers", frame.where);
  std::vector<double> query;
  for (const Json& value : values) {
    if (!value.is_number())
      fail(ErrorKind::data, "{}: 'query' must be an array of finite numbers", frame.where);
    query.push_back(checked_input(value.get<double>(), frame.where + ": 'query'"));
  }
  return query;
}

struct BlenderFrame {
  Node node;
  fs::path image, mask;  // empty if the file does not exist
};

// SplitFile is a file transforms_*.json with the files that its frames name. Frames with "is_bad" are left
// out.
struct SplitFile {
  std::string split;
  Node file;
  std::vector<BlenderFrame> frames;
  TimeRange times;
};

// BlenderFolder holds the files of all splits of a folder.
struct BlenderFolder {
  DataRoot root;
  fs::path path;
  NamedFiles files{root, path};
  std::list<Json> json;
  std::vector<SplitFile> splits;
  std::size_t masks = 0, rounded_poses = 0;

  const SplitFile* find(const std::string& split) const {
    const auto it = std::ranges::find(splits, split, &SplitFile::split);
    return it == splits.end() ? nullptr : &*it;
  }
};

// Reads the files of all splits. The files of all splits that the frames name are searched for together.
// Otherwise, if all images of one split were missing, the file r_0 of another split could be mistaken for the
// missing r_0.
void read_splits(BlenderFolder& folder, const DatasetOptions& options, LoadReport& report) {
  std::vector<Node> nodes;
  for (const char* split : {"train", "test", "val"}) {
    if (!has_blender_split(folder.path, split)) continue;
    const fs::path path = transforms_path(folder.path, split);
    // A test file without frames is accepted if there is a train file, which is read first.
    const bool may_be_empty = folder.find("train") != nullptr;
    const Json& json = folder.json.emplace_back(parse_file(folder.root.check(path), "frames", may_be_empty));
    SplitFile& file = folder.splits.emplace_back(SplitFile{split, {json, path.string()}, {}, {}});
    for (const Node& node : frame_nodes(json, path.string())) {
      node.text("file_path");
      file.times.add(raw_time(node));
      nodes.push_back(node);
    }
  }
  check_times(nodes);
  std::vector<fs::path> images = stated_images(folder.files, nodes, folder.path, folder.root, options);
  const std::vector<fs::path> masks =
      stated_files(folder.files, nodes, "mask_path", folder.path, NamedFiles::Kind::mask);
  std::size_t i = 0;
  for (SplitFile& file : folder.splits)
    for (std::size_t end = i + file.file.json["frames"].size(); i < end; ++i) {
      if (nodes[i].flag("is_bad")) {
        report.skip(nodes[i].text("file_path"), "the frame has 'is_bad': true");
        images[i].clear();
        continue;
      }
      file.frames.push_back({nodes[i], images[i], masks[i]});
    }
  folder.masks = count_masks(folder.files, nodes, images, masks, folder.path);
}

struct PendingView {
  View view;
  const BlenderFrame* frame;
};

// Throws if the lens has distortion, because this loader does not undistort images.
void refuse_distortion(const Node& frame, const Node& file, ImageSize size) {
  const Lens lens = read_lens(frame, file, size);
  if (!lens.distorted()) return;
  std::string what = fmt::format("the camera model {}", camera_model(frame, file));
  const std::vector<std::string_view> names = words_of(lens.formula->coefficients);
  for (std::size_t i = names.size(); i-- > 0;)
    if (lens.k[i] != 0) what = fmt::format("'{}' = {}", names[i], lens.k[i]);
  fail(ErrorKind::data,
       "{}: {}: lens distortion is not supported in the Blender layout: pass the JSON file "
       "instead of the folder to load it as nerfstudio data",
       frame.where, what);
}

// Determines the size of the view and reads the pixels if the image file exists.
void complete_view(PendingView& pending, const Node& file, const DatasetOptions& options, bool lazy) {
  const auto& [frame, image, mask] = *pending.frame;
  const bool exists = !image.empty();
  const std::optional<ImageSize> stated = stated_size(frame, file, image);
  View& view = pending.view;
  ImageSize original;
  if (exists) {
    const ImageInfo info = image_file_info(image);
    view.file = image;
    original = info.size;
    // The notes of check_image_size() about rescaled images are discarded: every reduced image would cause
    // the same note, and rescaling is normal in this layout.
    LoadReport notes;
    if (stated) check_image_size(original, *stated, image.string(), notes);
    view.opaque = info.opaque;
    view.masked = !mask.empty();
  } else if (stated) {
    original = *stated;
  } else {
    fail(ErrorKind::data, "{}: image {} does not exist, and the JSON has no 'w' and 'h'", frame.where,
         frame.text("file_path"));
  }
  const ImageSize actual{downscaled(original.width, options.read.downscale),
                         downscaled(original.height, options.read.downscale)};
  refuse_distortion(frame, file, stated.value_or(original));
  set_intrinsics(view.camera, frame, file, stated.value_or(original), actual);
  check_camera(view.camera, frame.where);
  if (!exists || !options.load_images) return;
  view.source = file_image_source({.path = image,
                                   .mask = mask,
                                   .background = options.background,
                                   .undistortion = {},
                                   .width = actual.width,
                                   .height = actual.height});
  if (lazy) return;
  view.image = view.source->load();
  view.source.reset();
}

// Returns the views of a split. If `report` is not null and images are needed, views without an image are
// skipped.
Split make_split(BlenderFolder& folder, const SplitFile& file, const DatasetOptions& options, bool lazy,
                 LoadReport* report) {
  Split result{file.split, {}};
  const std::vector<BlenderFrame>& frames = file.frames;
  const bool needs_images = report && options.load_images;
  const auto lacks_image = [](const BlenderFrame& frame) { return frame.image.empty(); };
  const std::string file_name = fs::path(file.file.where).filename().string();
  if (frames.empty()) {
    if (file.split == "train") fail(ErrorKind::data, "{}: all frames have 'is_bad': true", file.file.where);
    if (report)
      report->note_difference(
          fmt::format("no {} split: {} has no frames that can be used", file.split, file_name));
    return result;
  }
  if (needs_images && std::ranges::all_of(frames, lacks_image)) {
    if (file.split == "train") {
      std::vector<Node> nodes;
      for (const BlenderFrame& frame : frames) nodes.push_back(frame.node);
      fail(ErrorKind::data, "{}: {}", file.file.where, no_images(folder.files, nodes, folder.path, options));
    }
    const std::string first = folder.files.missing(folder.path, frames[0].node.text("file_path"));
    report->note_difference(fmt::format("no {} split: none of the {} images of {} exists: for example, {}",
                                        file.split, frames.size(), file_name, first));
    return result;
  }
  // Times are normalised with the time range of the train file. If there is no train file, the time range of
  // the split's own file is used instead.
  const SplitFile* train = folder.find("train");
  const TimeRange& times = train ? train->times : file.times;
  const std::size_t queries = read_query(frames[0].node).size();
  std::size_t outside = 0;
  std::vector<PendingView> pending;
  for (const BlenderFrame& frame : frames) {
    const Node& node = frame.node;
    const std::string name = node.text("file_path");
    if (needs_images && frame.image.empty()) {
      report->skip(name, "the image does not exist");
      continue;
    }
    View view;
    view.name = frame_name(shown_name(frame.image, name).string());
    folder.rounded_poses += set_pose(view.camera, node);
    const double time = raw_time(node);
    outside += !times.contains(time);
    view.camera.time = times.normalise(time);
    view.camera.extra = read_query(node);
    if (view.camera.extra.size() != queries)
      fail(ErrorKind::data, "{}: 'query' has {} values, but 'query' of the first frame has {}", node.where,
           view.camera.extra.size(), queries);
    pending.push_back({std::move(view), &frame});
  }
  if (report && outside > 0)
    report->note(fmt::format(
        "the times of {} of the {} views of the split {} are outside of the range of the training "
        "times ({} to {}): the model must extrapolate",
        outside, pending.size(), file.split, times.low, times.high));
  parallel_for(pending.size(), [&](std::size_t i) { complete_view(pending[i], file.file, options, lazy); });
  for (PendingView& p : pending) result.views.push_back(std::move(p.view));
  make_view_names_unique(result.views);
  return result;
}

}  // namespace

bool has_blender_split(const fs::path& folder, const std::string& split) {
  return path_exists(transforms_path(folder, split));
}

Split load_blender_split(const fs::path& path, const std::string& split, const DatasetOptions& options) {
  BlenderFolder folder{DataRoot(path, options.read.allow_outside), path};
  LoadReport report;
  read_splits(folder, options, report);
  const SplitFile* file = folder.find(split);
  if (!file) fail(ErrorKind::data, "{}: no such file", transforms_path(path, split).string());
  return make_split(folder, *file, options, false, nullptr);
}

LoadedScene load_blender(const fs::path& path, const DatasetOptions& options) {
  BlenderFolder folder{DataRoot(path, options.read.allow_outside), path};
  LoadedScene scene;
  read_splits(folder, options, scene.report);
  if (folder.splits.empty())
    fail(ErrorKind::data,
         "{}: this folder contains no transforms_train.json, transforms_val.json or transforms_test.json",
         path.string());
  for (const SplitFile& file : folder.splits) {
    Split split = make_split(folder, file, options, true, &scene.report);
    if (!split.views.empty()) scene.splits.push_back(std::move(split));
  }
  if (scene.splits.empty())
    fail(ErrorKind::data,
         "{}: {}; copy the images to the places that 'file_path' states, or correct 'file_path'",
         path.string(), scene.report.notes.front());
  if (folder.masks > 0) scene.report.note(fmt::format("{} masks: masked pixels are ignored", folder.masks));
  note_rounded_poses(folder.rounded_poses, scene.report);
  note_shared_images(scene.splits, scene.report);
  for (const SplitFile& file : folder.splits)
    if (!scene.points) take_stated_points(folder.files, file.file, path, scene);
  for (const char* name : {"points3d.ply", "points3D.ply"})
    if (const fs::path points = path / name; !scene.points && path_exists(points))
      take_points(folder.root.check(points), scene);
  folder.files.report(scene.report);
  return scene;
}

}  // namespace ubs
