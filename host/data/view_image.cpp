// SPDX-License-Identifier: Apache-2.0
// See view_image.hpp.
#include "host/data/view_image.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "host/base/error.hpp"
#include "host/base/paths.hpp"
#include "host/data/image_info.hpp"
#include "host/data/image_source.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

int reduced(int ideal, double stated, int factor) {
  return std::min(ideal, downscaled(static_cast<int>(std::lround(stated)), factor));
}

void report_size(ImageSize file, const Lens& lens, LoadReport& report) {
  const double ratio = static_cast<double>(lens.width) / file.width;
  if (file.width != lens.width || file.height != lens.height)
    report.note(fmt::format("images have {}x{} pixels, the cameras {}x{} (ratio {:.3f}): intrinsics rescaled",
                            file.width, file.height, lens.width, lens.height, ratio));
  const double other = static_cast<double>(lens.height) / file.height;
  if (std::abs(ratio - other) > 0.01 * ratio)
    report.note(fmt::format(
        "images of {}x{} have another shape than their cameras ({}x{}): is this the right folder?",
        file.width, file.height, lens.width, lens.height));
}

}  // namespace

bool attach_image(View& view, const Lens& lens, const fs::path& file, const fs::path& mask,
                  const DatasetOptions& options, LoadReport& report) {
  const bool exists = path_exists(file);
  ImageSize size{lens.width, lens.height};
  if (exists) {
    const ImageInfo info = image_file_info(file);
    view.file = file;
    size = info.size;
    view.opaque = info.opaque;
    report_size(size, lens, report);
    if (info.orientation != 1)
      report.note(
          fmt::format("EXIF orientation {} ignored: cameras describe the stored pixels", info.orientation));
  }
  const Lens actual = lens.scaled_to(size.width, size.height);
  FileImage image{file, mask, options.background, std::nullopt, 0, 0};
  ImageSize ideal = size;
  double cx = actual.cx, cy = actual.cy;
  if (actual.distorted()) {
    static thread_local Undistortion plan;  // most images have the lens of the one before
    if (plan.lens != actual) plan = plan_undistortion(actual, file.string());
    image.undistortion = plan;
    ideal = {plan.width, plan.height};
    cx = plan.cx, cy = plan.cy;
    report.undistort(std::int64_t{ideal.width} * ideal.height,
                     fmt::format("undistorted {}x{} to {}x{} at the same focal length", size.width,
                                 size.height, ideal.width, ideal.height));
  }
  Camera& camera = view.camera;
  camera.width = image.width = reduced(
      ideal.width, static_cast<double>(ideal.width) * lens.width / size.width, options.read.downscale);
  camera.height = image.height = reduced(
      ideal.height, static_cast<double>(ideal.height) * lens.height / size.height, options.read.downscale);
  const double sx = static_cast<double>(camera.width) / ideal.width;
  const double sy = static_cast<double>(camera.height) / ideal.height;
  camera.fx = actual.fx * sx, camera.fy = actual.fy * sy;
  camera.cx = cx * sx, camera.cy = cy * sy;
  view.masked = exists && !mask.empty();
  if (exists && options.load_images)
    view.source = file_image_source(std::move(image), options.read.cache_folder);
  return exists;
}

std::vector<Split> split_every(std::vector<View> views, int test_every) {
  std::ranges::stable_sort(views, {}, &View::name);
  Split train{"train", {}}, test{"test", {}};
  for (std::size_t i = 0; i < views.size(); ++i) {
    const bool held = test_every > 0 && i % static_cast<std::size_t>(test_every) == 0;
    (held ? test : train).views.push_back(std::move(views[i]));
  }
  std::vector<Split> splits;
  splits.push_back(std::move(train));
  if (!test.views.empty()) splits.push_back(std::move(test));
  return splits;
}

std::string view_name(const fs::path& relative) {
  std::string name = (relative.parent_path() / relative.stem()).lexically_normal().string();
  std::ranges::replace(name, '/', '_');
  while (name.starts_with("._") || name.starts_with('_')) name.erase(0, 1);
  return name;
}

}  // namespace ubs
