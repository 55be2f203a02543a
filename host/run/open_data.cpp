// SPDX-License-Identifier: Apache-2.0
#include "host/run/open_data.hpp"

#include "host/base/error.hpp"
#include "host/base/warning.hpp"
#include "host/dataset/packed.hpp"
#include "host/run/run_cameras.hpp"

namespace ubs {

namespace {

DatasetOptions reading_options(const TrainSettings& settings) {
  return {.read = settings,
          .images_from_user = settings.chosen.contains("images"),
          .background = settings.background.colour};
}

// Refuses settings that the user has set for a packed file, but that only other data use. The same settings
// are ignored if a run states them, because they may be settings for the folder that was packed.
void refuse_for_packed(const std::filesystem::path& file, const TrainSettings& settings) {
  if (!is_packed(file)) return;
  DatasetOptions own = reading_options(settings);
  const ReadSettings usual;
  if (!settings.chosen.contains("images")) own.read.images = usual.images;
  if (!settings.chosen.contains("colmap_model")) own.read.colmap_model = usual.colmap_model;
  if (!settings.chosen.contains("test_every")) own.read.test_every = usual.test_every;
  if (!settings.chosen.contains("frames")) own.read.frames = usual.frames;
  refuse_unused(own, "packed", "");
}

}  // namespace

Dataset open_dataset(const std::filesystem::path& folder, const std::vector<std::string>& image_splits,
                     const TrainSettings& settings, Images images) {
  refuse_for_packed(folder, settings);
  DatasetOptions options = reading_options(settings);
  options.load_images = images == Images::load;
  options.image_splits = image_splits;
  return load_dataset(folder, options);
}

OpenedData open_undecoded(const std::filesystem::path& folder, const TrainSettings& settings) {
  refuse_for_packed(folder, settings);
  const DatasetOptions reading = reading_options(settings);
  return {folder, reading, open_undecoded(folder, reading)};
}

Dataset open_dataset(const std::optional<OpenedData>& opened, const std::filesystem::path& folder,
                     const std::vector<std::string>& image_splits, const TrainSettings& settings,
                     Images images) {
  DatasetOptions options = reading_options(settings);
  // The size of the image cache only affects decoding, so a different size does not prevent reuse.
  if (opened) options.read.image_cache_mb = opened->reading.read.image_cache_mb;
  if (!opened || opened->folder != folder || opened->reading != options)
    return open_dataset(folder, image_splits, settings, images);
  options = reading_options(settings);
  options.image_splits = image_splits;
  Dataset data = opened->data;
  if (images == Images::load)
    decode_images(data, options);
  else
    for (Split& split : data.splits)
      for (View& view : split.views) view.source.reset();
  return data;
}

Split take_split(Dataset& data, const std::string& split) {
  return std::move(const_cast<Split&>(need_split(data, split)));
}

const Split& need_split(const Dataset& data, const std::string& split) {
  std::vector<std::string> names;
  for (const Split& candidate : data.splits) {
    if (candidate.name == split && !candidate.views.empty()) return candidate;
    if (!candidate.views.empty()) names.push_back(candidate.name);
  }
  fail(ErrorKind::data, "{}: split '{}' has no views; available: {}", data.report.folder, split,
       fmt::join(names, ", "));
}

void warn_skipped(const LoadReport& report) {
  for (const auto& s : report.skipped)
    warn("{} skipped: {} ({}{})", s.count, s.why, fmt::join(s.examples, ", "),
         s.count > s.examples.size() ? ", ..." : "");
}

Split open_split_for(const std::array<double, 3>& offset, const std::filesystem::path& folder,
                     const std::string& split, const TrainSettings& settings, Images images,
                     const std::optional<OpenedData>& opened) {
  Dataset data = open_dataset(opened, folder, {split}, settings, images);
  for (const std::string& note : data.report.differences) warn("{}", note);
  warn_skipped(data.report);
  Split taken = take_split(data, split);
  if (data.offset != offset) rebase(taken.views, data.offset, offset);
  if (!settings.run_cameras.empty()) use_run_cameras(settings.run_cameras, taken, offset);
  return taken;
}

// N is the sum of 3 for the position, 3 for the direction (if N >= 6), 1 for the time (if N is not 3 or 6),
// and the number of further query values. The dimensions have the order of docs/method.md, section 1.2.
std::size_t further_queries(int dim) {
  const int query = dim - 3 - (dim >= 6 ? 3 : 0);
  return query > 1 ? static_cast<std::size_t>(query - 1) : 0;
}

void check_query(const Split& split, int dim) {
  const std::size_t needed = further_queries(dim);
  for (const View& view : split.views)
    if (view.camera.extra.size() < needed)
      fail(ErrorKind::data,
           "view '{}' of split '{}' has {} further query values besides direction and time (field 'query' of "
           "the frame), but a model with N = {} requires {}",
           view.name, split.name, view.camera.extra.size(), dim, needed);
}

void require_images(const Split& split) {
  for (const View& view : split.views)
    if (!view.has_image())
      fail(ErrorKind::data, "view '{}' of split '{}' has no image file", view.name, split.name);
}

}  // namespace ubs
