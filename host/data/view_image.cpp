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

// Returns the part of the image, in percent, that the undistorted one leaves out: found on a grid of its
// pixels.
double percent_left_out(const Undistortion& plan) {
  constexpr int kGrid = 32;
  const Lens& lens = plan.lens;
  int outside = 0;
  for (int j = 0; j < kGrid; ++j)
    for (int i = 0; i < kGrid; ++i) {
      const double u = (i + 0.5) * lens.width / kGrid, v = (j + 0.5) * lens.height / kGrid;
      const auto ray = pixel_ray(lens, u, v);
      const bool front = ray && (*ray)[2] > 0;
      const double column = front ? (*ray)[0] / (*ray)[2] * lens.fx + plan.cx : -1;
      const double row = front ? (*ray)[1] / (*ray)[2] * lens.fy + plan.cy : -1;
      outside += !(column >= 0 && column <= plan.width && row >= 0 && row <= plan.height);
    }
  return 100.0 * outside / (kGrid * kGrid);
}

double degrees_across(double focal, double centre, int size) {
  return (std::atan(centre / focal) + std::atan((size - centre) / focal)) * 180 / std::acos(-1.0);
}

}  // namespace

void check_image_size(ImageSize file, ImageSize camera, const std::string& where, LoadReport& report) {
  if (file == camera) return;
  if (file.width == camera.height && file.height == camera.width)
    fail(ErrorKind::data,
         "{}: the image has {}x{} pixels and its camera {}x{}: the image is turned by 90 degrees; turn it "
         "back "
         "(some programs apply the EXIF orientation when they copy images), or make the cameras again",
         where, file.width, file.height, camera.width, camera.height);
  const double across = static_cast<double>(camera.width) / file.width;
  const double down = static_cast<double>(camera.height) / file.height;
  // Rounding to whole pixels moves a size by less than one pixel of the coarser of the two.
  const double coarse = std::max({1.0, 1 / across, 1 / down});
  if (std::abs(file.width - camera.width / down) > coarse &&
      std::abs(file.height - camera.height / across) > coarse)
    fail(ErrorKind::data,
         "{}: the image has {}x{} pixels and its camera {}x{}, which is another shape: use the images that "
         "the "
         "cameras were made from, or copies of them with width and height scaled alike",
         where, file.width, file.height, camera.width, camera.height);
  report.note(fmt::format("images have {}x{} pixels, the cameras {}x{} (ratio {:.3f}): intrinsics rescaled",
                          file.width, file.height, camera.width, camera.height, across));
}

bool attach_image(View& view, const Lens& lens, const fs::path& file, const fs::path& mask,
                  const DatasetOptions& options, LoadReport& report) {
  const bool exists = path_exists(file);
  ImageSize size{lens.width, lens.height};
  if (exists) {
    const ImageInfo info = image_file_info(file);
    view.file = file;
    size = info.size;
    view.opaque = info.opaque;
    check_image_size(size, {lens.width, lens.height}, file.string(), report);
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
    static thread_local double left_out = 0;
    if (plan.lens != actual) {
      plan = plan_undistortion(actual, file.string());
      left_out = percent_left_out(plan);
    }
    image.undistortion = plan;
    ideal = {plan.width, plan.height};
    cx = plan.cx, cy = plan.cy;
    report.undistort(
        std::int64_t{ideal.width} * ideal.height,
        fmt::format("undistorted {}x{} to {}x{} ({:.0f} degrees across, {:.0f} % of the picture left "
                    "out) at the same focal length",
                    size.width, size.height, ideal.width, ideal.height,
                    degrees_across(actual.fx, cx, ideal.width), left_out));
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
