// SPDX-License-Identifier: Apache-2.0
// See blender.hpp. The cameras are read first, one frame after the other, then the images in parallel.
#include "host/data/blender.hpp"

#include <algorithm>
#include <limits>

#include "host/base/error.hpp"
#include "host/base/parallel.hpp"
#include "host/base/paths.hpp"
#include "host/data/data_root.hpp"
#include "host/data/frames_json.hpp"
#include "host/data/image.hpp"
#include "host/data/image_info.hpp"
#include "host/data/image_source.hpp"
#include "host/data/named_files.hpp"
#include "host/data/view_image.hpp"
#include "host/data/view_names.hpp"

namespace ubs {

namespace {

namespace fs = std::filesystem;
using namespace frames;

fs::path transforms_path(const fs::path& folder, const std::string& split) {
  return folder / ("transforms_" + split + ".json");
}

double raw_time(const Node& frame) { return frame.has("time") ? frame.number("time") : 0.0; }

struct TimeRange {
  double low = 0, high = 0;
  double normalise(double t) const { return high > low ? (t - low) / (high - low) : 0.0; }
};

TimeRange time_range(const Json& file, const std::string& path) {
  TimeRange range{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
  for (std::size_t i = 0; i < file["frames"].size(); ++i) {
    const double t = raw_time(frame_node(file, i, path));
    range.low = std::min(range.low, t);
    range.high = std::max(range.high, t);
  }
  return range;
}

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

struct PendingView {
  View view;
  Node frame;
  fs::path image;
};

// Throws if the frame or the file has a distortion coefficient that is not 0. The JSON files of nerfstudio
// have such coefficients, and this loader would ignore them.
void refuse_distortion(const Node& frame, const Node& file) {
  for (const char* key : {"k1", "k2", "k3", "k4", "p1", "p2"})
    if (const double value = lookup(frame, file, key).value_or(0.0); value != 0)
      fail(ErrorKind::data,
           "{}: '{}' = {}: lens distortion is not supported in the Blender layout: pass the JSON file "
           "instead of the folder to load it as nerfstudio data",
           frame.where, key, value);
}

// Determines the size of the view and reads the pixels if the image file exists.
void complete_view(PendingView& pending, const Node& file, const DatasetOptions& options, bool lazy) {
  const bool exists = !pending.image.empty();
  const std::optional<ImageSize> stated = stated_size(pending.frame, file, pending.image);
  View& view = pending.view;
  ImageSize original;
  if (exists) {
    const ImageInfo info = image_file_info(pending.image);
    view.file = pending.image;
    original = info.size;
    // The notes of check_image_size() about rescaled images are discarded: every reduced image would cause
    // the same note, and rescaling is normal in this layout.
    LoadReport notes;
    if (stated) check_image_size(original, *stated, pending.image.string(), notes);
    view.opaque = info.opaque;
  } else if (stated) {
    original = *stated;
  } else {
    fail(ErrorKind::data, "{}: image {} does not exist, and the JSON has no 'w' and 'h'", pending.frame.where,
         pending.frame.text("file_path"));
  }
  const ImageSize actual{downscaled(original.width, options.read.downscale),
                         downscaled(original.height, options.read.downscale)};
  refuse_distortion(pending.frame, file);
  set_intrinsics(view.camera, pending.frame, file, stated.value_or(original), actual);
  check_camera(view.camera, pending.frame.where);
  if (!exists || !options.load_images) return;
  view.source = file_image_source({.path = pending.image,
                                   .mask = {},
                                   .background = options.background,
                                   .undistortion = {},
                                   .width = actual.width,
                                   .height = actual.height});
  if (lazy) return;
  view.image = view.source->load();
  view.source.reset();
}

// Finds the images of a split. If some are not at their exact paths, the images of all splits are searched
// for together. Otherwise, if all images of one split were missing, the file r_0 of another split could be
// mistaken for the missing r_0.
std::vector<fs::path> find_images(NamedFiles& files, const DataRoot& root, const fs::path& folder,
                                  const std::string& split, std::vector<StatedName> names) {
  const std::size_t count = names.size();
  const bool all_there = files.has_all(folder, names);
  for (const char* other : {"train", "test", "val"}) {
    if (all_there || other == split || !has_blender_split(folder, other)) continue;
    const std::string path = transforms_path(folder, other).string();
    const Json json = parse_file(root.check(path));
    for (std::size_t i = 0; i < json["frames"].size(); ++i) {
      const Node frame = frame_node(json, i, path);
      names.push_back({frame.text("file_path"), frame.where});
    }
  }
  std::vector<fs::path> images = files.find(folder, names, NamedFiles::Kind::image);
  images.resize(count);
  return images;
}

}  // namespace

bool has_blender_split(const fs::path& folder, const std::string& split) {
  return path_exists(transforms_path(folder, split));
}

Split load_blender_split(const fs::path& folder, const std::string& split, const DatasetOptions& options,
                         bool lazy, LoadReport* report) {
  const DataRoot root(folder, options.read.allow_outside);
  const std::string path = transforms_path(folder, split).string();
  const Json json = parse_file(root.check(path));
  const Node file{json, path};
  // Times are normalised with the time range of the train file. If there is no train file, the time range of
  // the split's own file is used instead.
  const bool other = split != "train" && has_blender_split(folder, "train");
  const TimeRange times = other ? time_range(parse_file(root.check(transforms_path(folder, "train"))),
                                             transforms_path(folder, "train").string())
                                : time_range(json, path);

  std::vector<StatedName> names;
  for (std::size_t i = 0; i < json["frames"].size(); ++i) {
    const Node frame = frame_node(json, i, path);
    names.push_back({frame.text("file_path"), frame.where});
  }
  NamedFiles files(root, folder);
  const std::vector<fs::path> images = find_images(files, root, folder, split, names);
  // Views may lack their images if there is no report, or if only the cameras are wanted.
  const bool needs_images = report && options.load_images;
  const auto absent = std::ranges::find_if(images, [](const fs::path& image) { return image.empty(); });
  if (needs_images && absent != images.end()) {
    const auto count = std::ranges::count_if(images, [](const fs::path& image) { return image.empty(); });
    const std::string first =
        files.missing(folder, names[static_cast<std::size_t>(absent - images.begin())].name);
    const std::string file_name = fs::path(path).filename().string();
    const bool none = static_cast<std::size_t>(count) == images.size();
    if (split == "train")
      fail(ErrorKind::data, "{}: {}: for example, {}; copy the images there or correct 'file_path'", path,
           none ? fmt::format("none of the {} images exists", count)
                : fmt::format("{} of {} images do not exist", count, images.size()),
           first);
    if (none) {
      report->note_difference(fmt::format("no {} split: none of the {} images of {} exists: for example, {}",
                                          split, count, file_name, first));
      return {split, {}};
    }
  }
  std::vector<PendingView> pending;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const Node frame = frame_node(json, i, path);
    if (needs_images && images[i].empty()) {
      report->skip(names[i].name, "the image does not exist");
      continue;
    }
    View view;
    view.name = frame_name(shown_name(images[i], names[i].name).string());
    set_pose(view.camera, frame);
    view.camera.time = times.normalise(raw_time(frame));
    view.camera.extra = read_query(frame);
    if (!pending.empty() && view.camera.extra.size() != pending[0].view.camera.extra.size())
      fail(ErrorKind::data, "{}: 'query' has {} values, but 'query' of frame 0 has {}", frame.where,
           view.camera.extra.size(), pending[0].view.camera.extra.size());
    pending.push_back({std::move(view), frame, images[i]});
  }
  if (report) files.report(*report);
  parallel_for(pending.size(), [&](std::size_t i) { complete_view(pending[i], file, options, lazy); });

  Split result{split, {}};
  for (PendingView& p : pending) result.views.push_back(std::move(p.view));
  settle_view_names(result.views);
  return result;
}

}  // namespace ubs
