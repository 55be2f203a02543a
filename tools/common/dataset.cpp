// SPDX-License-Identifier: Apache-2.0
#include "tools/common/dataset.hpp"

#include "host/base/error.hpp"
#include "host/data/blender.hpp"

namespace ubs::tools {

Split open_split(const std::filesystem::path& folder, const std::string& split, const TrainSettings& settings,
                 Images images) {
  Split loaded = load_blender_split(folder, split,
                                    {.background = settings.background,
                                     .load_images = images == Images::load,
                                     .downscale = settings.downscale});
  if (loaded.views.empty()) fail(ErrorKind::data, "{}: split '{}' has no views", folder.string(), split);
  return loaded;
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
