// SPDX-License-Identifier: Apache-2.0
// See view_image.hpp.
#include "host/dataset/view_image.hpp"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>

#include "host/base/error.hpp"
#include "host/base/paths.hpp"
#include "host/dataset/image_info.hpp"
#include "host/dataset/image_source.hpp"
#include "host/dataset/wide_image_file.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

int reduced(int ideal, double stated, int factor) {
  return std::min(ideal, downscaled(static_cast<int>(std::lround(stated)), factor));
}

// Returns whether the mask leaves any pixel of the view that `plan` describes.
bool counts_any(const Image8& mask, const Undistortion& plan) {
  Image8 pixels = undistort(mask, plan);
  set_mask(pixels, pixels);
  for (int j = 0; j < plan.height; ++j)
    for (int i = 0; i < plan.width; ++i)
      if (pixels.mask[static_cast<std::size_t>(j) * static_cast<std::size_t>(plan.width) +
                      static_cast<std::size_t>(i)] != 0 &&
          covers(plan, i + 0.5, j + 0.5))
        return true;
  return false;
}

double degrees_across(double focal, double centre, int size) {
  return (std::atan(centre / focal) + std::atan((size - centre) / focal)) * 180 / std::acos(-1.0);
}

// Sets the properties of the view that the image file determines. Returns the lens for an image of the size
// of the file. If the file does not exist, sets nothing and returns `lens`.
Lens with_file(View& view, const Lens& lens, const fs::path& file, LoadReport& report) {
  if (!path_exists(file)) return lens;
  const ImageInfo info = image_file_info(file);
  view.file = file;
  view.opaque = info.opaque;
  check_image_size(info.size, {lens.width, lens.height}, file.string(), report);
  if (info.orientation != 1)
    report.note(
        fmt::format("EXIF orientation {} is ignored: cameras describe the stored pixels", info.orientation));
  return lens.scaled_to(info.size.width, info.size.height);
}

// Returns the plan for an image of a pinhole camera, which needs no resampling.
Undistortion pinhole_plan(const Lens& lens) {
  Undistortion plan;
  plan.lens = lens;
  plan.width = lens.width, plan.height = lens.height;
  plan.fx = lens.fx, plan.fy = lens.fy, plan.cx = lens.cx, plan.cy = lens.cy;
  return plan;
}

// Sets the camera and the image source of a view. `stated` is the lens for an image of the size that the data
// set states.
void set_view(View& view, const Lens& stated, const Undistortion& plan, const fs::path& file,
              const fs::path& mask, const DatasetOptions& options) {
  FileImage image{file, mask, options.background, std::nullopt, 0, 0};
  view.resampled = plan.lens.distorted();
  if (view.resampled) image.undistortion = plan;
  Camera& camera = view.camera;
  camera = camera_of(plan, camera);
  camera.width = image.width = reduced(
      plan.width, static_cast<double>(plan.width) * stated.width / plan.lens.width, options.read.downscale);
  camera.height = image.height =
      reduced(plan.height, static_cast<double>(plan.height) * stated.height / plan.lens.height,
              options.read.downscale);
  const double sx = static_cast<double>(camera.width) / plan.width;
  const double sy = static_cast<double>(camera.height) / plan.height;
  camera.fx *= sx, camera.fy *= sy, camera.cx *= sx, camera.cy *= sy;
  const bool exists = !view.file.empty();
  view.masked = exists && (!mask.empty() || !plan.whole);
  if (exists && options.load_images)
    view.source = file_image_source(std::move(image), options.read.cache_folder);
}

}  // namespace

void check_image_size(ImageSize file, ImageSize camera, const std::string& where, LoadReport& report) {
  if (file == camera) return;
  if (file.width == camera.height && file.height == camera.width)
    fail(ErrorKind::data,
         "{}: the image has {}x{} pixels, but its camera has {}x{}, so it is rotated by 90 degrees: rotate "
         "it back (some programs apply the EXIF orientation when they copy images), or create the "
         "cameras again",
         where, file.width, file.height, camera.width, camera.height);
  const double across = static_cast<double>(camera.width) / file.width;
  const double down = static_cast<double>(camera.height) / file.height;
  // Rounding to whole pixels changes a size by less than one pixel of the smaller of the two images.
  const double coarse = std::max({1.0, 1 / across, 1 / down});
  if (std::abs(file.width - camera.width / down) > coarse &&
      std::abs(file.height - camera.height / across) > coarse)
    fail(ErrorKind::data,
         "{}: the image has {}x{} pixels, but its camera has {}x{}, which is a different aspect ratio: use "
         "the images that the cameras were created from, or copies of them with width and height scaled by "
         "the same factor",
         where, file.width, file.height, camera.width, camera.height);
  report.note(fmt::format(
      "images have {}x{} pixels, but cameras have {}x{} (ratio {:.3f}): the intrinsics were rescaled",
      file.width, file.height, camera.width, camera.height, across));
}

bool attach_image(View& view, const Lens& lens, const fs::path& file, const fs::path& mask,
                  const DatasetOptions& options, LoadReport& report) {
  const Lens actual = with_file(view, lens, file, report);
  if (actual.distorted()) fail(ErrorKind::internal, "{}: the lens has distortion", file.string());
  set_view(view, lens, pinhole_plan(actual), file, mask, options);
  return !view.file.empty();
}

std::size_t append_views(std::vector<View>& views, const View& view, const Lens& lens, const fs::path& file,
                         const fs::path& mask, const DatasetOptions& options, LoadReport& report) {
  View base = view;
  const Lens actual = with_file(base, lens, file, report);
  if (!actual.distorted()) {
    set_view(base, lens, pinhole_plan(actual), file, mask, options);
    views.push_back(std::move(base));
    return 1;
  }
  // The plans are kept for the next call, because most images have the same lens as the previous image.
  static thread_local std::vector<Undistortion> plans;
  static thread_local double left_out = 0;
  if (plans.empty() || plans[0].lens != actual) {
    plans = plan_views(actual, file.string());
    left_out = percent_left_out(plans);
  }
  if (actual.formula->all_directions && actual.width != 2 * actual.height)
    report.note_difference(
        fmt::format("panoramas have {}x{} pixels, so they are not twice as wide as high: they are read as "
                    "stretched images of 360 by 180 degrees",
                    actual.width, actual.height));
  std::int64_t pixels = 0;
  for (const Undistortion& plan : plans) pixels += std::int64_t{plan.width} * plan.height;
  const Undistortion& first = plans[0];
  if (first.face.empty()) {
    report.undistort(pixels, fmt::format("undistorted {}x{} to {}x{} ({:.0f} degrees across, {:.0f} % of the "
                                         "image is lost) with the same focal length",
                                         actual.width, actual.height, first.width, first.height,
                                         degrees_across(actual.fx, first.cx, first.width), left_out));
    set_view(base, lens, first, file, mask, options);
    views.push_back(std::move(base));
    return 1;
  }
  std::vector<std::string> faces;
  for (const Undistortion& plan : plans)
    faces.push_back(fmt::format("{} {}x{}", plan.face, plan.width, plan.height));
  report.undistort(
      pixels,
      fmt::format("resampled {}x{} ({:.0f} degrees) to the views {} ({:.0f} % of the image is lost)",
                  actual.width, actual.height, degrees_covered(actual), fmt::join(faces, ", "), left_out));
  std::optional<Image8> mask_pixels;
  if (!mask.empty() && !base.file.empty() && options.load_images)
    mask_pixels = load_mask_image(mask, {actual.width, actual.height, {}});
  if (!base.file.empty() && options.load_images) {
    const int width = reduced(actual.width, lens.width, options.read.downscale);
    const int height = reduced(actual.height, lens.height, options.read.downscale);
    base.wide = std::make_shared<StoredWideImage>(
        WideLens{actual.scaled_to(width, height), first.max_angle}, file.string(),
        file_image_source({file, mask, options.background, std::nullopt, width, height}));
  }
  std::size_t count = 0;
  for (const Undistortion& plan : plans) {
    if (mask_pixels && !counts_any(*mask_pixels, plan)) continue;
    View face = base;
    face.part_of = base.name;
    face.name = base.name + "_" + plan.face;
    face.turn_in_wide = plan.rotation;
    set_view(face, lens, plan, file, mask, options);
    views.push_back(std::move(face));
    ++count;
  }
  if (count == 0)
    fail(ErrorKind::data, "{}: the mask {} leaves no pixel of the image", file.string(), mask.string());
  ++report.wide_images, report.wide_views += count;
  return count;
}

std::string view_name(const fs::path& relative) {
  std::string name = (relative.parent_path() / relative.stem()).lexically_normal().string();
  std::ranges::replace(name, '/', '_');
  while (name.starts_with("._") || name.starts_with('_')) name.erase(0, 1);
  return name;
}

}  // namespace ubs
