// SPDX-License-Identifier: Apache-2.0
#include "tools/common/dataset.hpp"

#include "host/base/error.hpp"
#include "host/data/blender.hpp"
#include "host/data/packed.hpp"
#include "host/data/point_cloud.hpp"

namespace ubs::tools {
namespace {

Split open_packed(const std::filesystem::path& data, const std::string& split, const TrainSettings& settings,
                  Images images) {
  const PackedFile file(data);
  if (file.background() != settings.background)
    fail(ErrorKind::data, "{}: was packed on the background {}; draw on that (--background {}), or pack it again",
         data.string(), fmt::join(file.background(), ","), fmt::join(file.background(), ","));
  if (settings.downscale != 1 && settings.downscale != file.downscale())
    fail(ErrorKind::data, "{}: was packed with --downscale {}, not {}; pack it again", data.string(),
         file.downscale(), settings.downscale);
  return file.split(split, images == Images::load);
}

}  // namespace

Split open_split(const std::filesystem::path& data, const std::string& split, const TrainSettings& settings,
                 Images images) {
  Split loaded = is_packed(data) ? open_packed(data, split, settings, images)
                                 : load_blender_split(data, split,
                                                      {.background = settings.background,
                                                       .load_images = images == Images::load,
                                                       .downscale = settings.downscale});
  if (loaded.views.empty()) fail(ErrorKind::data, "{}: split '{}' has no views", data.string(), split);
  return loaded;
}

bool has_split(const std::filesystem::path& data, const std::string& split) {
  return is_packed(data) ? PackedFile(data).has_split(split) : has_blender_split(data, split);
}

std::optional<PointCloud> open_points(const std::filesystem::path& data) {
  return is_packed(data) ? PackedFile(data).points() : find_point_cloud(data);
}

// N = 3 + direction (from N = 6 on) + time + further values, in the order of method.md 1.2.
void check_query(const Split& split, int dim) {
  const int query = dim - 3 - (dim >= 6 ? 3 : 0);
  const std::size_t needed = query > 1 ? static_cast<std::size_t>(query - 1) : 0;
  for (const View& view : split.views)
    if (view.camera.extra.size() < needed)
      fail(ErrorKind::data,
           "view '{}' of split '{}' has {} further query values; N = {} needs {} ('query' of a frame)",
           view.name, split.name, view.camera.extra.size(), dim, needed);
}

void require_images(const Split& split) {
  for (const View& view : split.views)
    if (view.image.rgb.empty())
      fail(ErrorKind::data, "view '{}' of split '{}' has no image file", view.name, split.name);
}

}  // namespace ubs::tools
