// SPDX-License-Identifier: Apache-2.0
// See lens_image.hpp.
#include "host/dataset/lens_image.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>

#include "host/base/error.hpp"
#include "host/base/memory_limit.hpp"
#include "host/base/parallel.hpp"
#include "host/base/vector3.hpp"

namespace ubs {
namespace {

constexpr int kSamples = 2;          // samples per pixel in each of the two directions
constexpr double kMaxFocal = 16384;  // [px per radian] plan_faces() accepts only focal lengths below this

// Returns the number of the half axis that is closest to the ray: 0 for +x, 1 for -x, 2 for +y, 3 for -y, 4
// for +z and 5 for -z.
std::size_t axis_of(const Ray& ray) {
  std::size_t axis = 0;
  for (std::size_t k = 1; k < 3; ++k)
    if (std::abs(ray[k]) > std::abs(ray[axis])) axis = k;
  return 2 * axis + (ray[axis] < 0 ? 1 : 0);
}

// Adds `part` times the bilinear interpolation of an image at a position [px] to `sum`. The image has
// `channels` values per pixel, and `sum` has `channels` values.
void add_sample(std::span<const float> image, std::size_t channels, int width, int height, double column,
                double row, float part, float* sum) {
  const double x = std::clamp(column - 0.5, 0.0, width - 1.0), y = std::clamp(row - 0.5, 0.0, height - 1.0);
  const auto x0 = static_cast<std::size_t>(x), y0 = static_cast<std::size_t>(y);
  const std::size_t x1 = std::min(x0 + 1, static_cast<std::size_t>(width) - 1);
  const std::size_t y1 = std::min(y0 + 1, static_cast<std::size_t>(height) - 1);
  const auto u = static_cast<float>(x - static_cast<double>(x0)),
             v = static_cast<float>(y - static_cast<double>(y0));
  const auto at = [&](std::size_t i, std::size_t j, std::size_t c) {
    return image[(j * static_cast<std::size_t>(width) + i) * channels + c];
  };
  for (std::size_t c = 0; c < channels; ++c)
    sum[c] += part * ((1 - v) * ((1 - u) * at(x0, y0, c) + u * at(x1, y0, c)) +
                      v * ((1 - u) * at(x0, y1, c) + u * at(x1, y1, c)));
}

}  // namespace

WideLens wide_lens(const std::string& text, int width, int height) {
  Lens lens;
  lens.width = width, lens.height = height;
  const auto take = [&](std::string_view name) {
    lens.formula = std::ranges::find(lens_models(), name, &LensModel::name)->formula;
  };
  if (text == "equirectangular") {
    take("EQUIRECTANGULAR");
    lens.set("w", width), lens.set("h", height);
    return {lens, std::numbers::pi};
  }
  constexpr std::string_view kFisheye = "fisheye";
  double degrees = 180;
  bool known = text.starts_with(kFisheye);
  if (known && text.size() > kFisheye.size()) {
    const char *first = text.data() + kFisheye.size() + 1, *end = text.data() + text.size();
    const auto [rest, error] = std::from_chars(first, end, degrees);
    known = first[-1] == ':' && error == std::errc{} && rest == end && degrees >= 1 && degrees <= 360;
  }
  if (!known)
    fail(ErrorKind::usage, "--lens {}: expected equirectangular, fisheye, or fisheye:DEGREES from 1 to 360",
         text);
  take("SIMPLE_FISHEYE");
  const double angle = degrees * std::numbers::pi / 180;
  lens.fx = lens.fy = std::min(width, height) / angle;
  lens.cx = width / 2.0, lens.cy = height / 2.0;
  return {lens, angle / 2};
}

LensImage::LensImage(const WideLens& wide, const std::string& where)
    : where_(where),
      fine_(wide.lens.scaled_to(kSamples * wide.lens.width, kSamples * wide.lens.height)),
      max_angle_(wide.max_angle) {
  if (fine_.fx >= kMaxFocal)
    fail(ErrorKind::usage,
         "{}: {}x{} pixels are too many for an angle of view of {:.3g} degrees: choose a smaller size", where,
         wide.lens.width, wide.lens.height, 360 / std::numbers::pi * max_angle_);
  plans_ = plan_faces(fine_, where);
  std::uint64_t pixels = 0;
  for (const Undistortion& plan : plans_)
    pixels += static_cast<std::uint64_t>(plan.width) * static_cast<std::uint64_t>(plan.height);
  require_memory(5 * sizeof(float) * pixels,
                 fmt::format("{}: an image of {}x{} pixels", where, wide.lens.width, wide.lens.height));
  face_of_axis_.fill(-1);
  for (std::size_t i = 0; i < plans_.size(); ++i) {
    const auto& m = plans_[i].rotation;  // its third row is the axis of the face
    face_of_axis_[axis_of({m[6], m[7], m[8]})] = static_cast<int>(i);
  }
}

void LensImage::check_complete() const {
  // plan_faces() skips faces with very few pixels. Check the rays of a grid of positions in the image.
  constexpr int kGrid = 64;
  for (int j = 0; j < kGrid; ++j)
    for (int i = 0; i < kGrid; ++i)
      if (const auto ray = shown_ray((i + 0.5) * fine_.width / kGrid, (j + 0.5) * fine_.height / kGrid);
          ray && face_of_axis_[axis_of(*ray)] < 0)
        fail(ErrorKind::usage,
             "{}: {}x{} pixels are too few, because parts of the image would be too small to render with "
             "this lens: choose a larger size",
             where_, fine_.width / kSamples, fine_.height / kSamples);
}

std::optional<Ray> LensImage::shown_ray(double column, double row) const {
  const auto ray = pixel_ray(fine_, column, row);
  if (!ray || std::atan2(std::hypot((*ray)[0], (*ray)[1]), (*ray)[2]) > max_angle_) return std::nullopt;
  return ray;
}

std::vector<Camera> LensImage::faces(const Camera& camera) const {
  std::vector<Camera> cameras;
  for (const Undistortion& plan : plans_) cameras.push_back(camera_of(plan, camera));
  return cameras;
}

template <typename Visit>
void LensImage::for_samples(const Visit& visit) const {
  const int width = fine_.width / kSamples, height = fine_.height / kSamples;
  parallel_for(static_cast<std::size_t>(height), [&](std::size_t j) {
    for (int i = 0; i < width; ++i)
      for (int s = 0; s < kSamples * kSamples; ++s) {
        const double column = kSamples * i + s % kSamples + 0.5;
        const double row = kSamples * static_cast<double>(j) + s / kSamples + 0.5;
        const auto ray = shown_ray(column, row);
        if (ray && face_of_axis_[axis_of(*ray)] >= 0)
          visit(j * static_cast<std::size_t>(width) + static_cast<std::size_t>(i), *ray);
      }
  });
}

std::vector<std::uint8_t> LensImage::shown() const {
  std::vector<std::uint8_t> samples(static_cast<std::size_t>(fine_.width / kSamples) *
                                    static_cast<std::size_t>(fine_.height / kSamples));
  for_samples([&](std::size_t pixel, const Ray&) { ++samples[pixel]; });
  for (std::uint8_t& count : samples) count = count == kSamples * kSamples ? 255 : 0;
  return samples;
}

RenderedView LensImage::compose(std::span<const RenderedView> faces) const {
  if (faces.size() != plans_.size())
    fail(ErrorKind::internal, "{} cube faces were rendered, but {} are needed to compose the image",
         faces.size(), plans_.size());
  RenderedView out{fine_.width / kSamples, fine_.height / kSamples, {}, {}, {}};
  const std::size_t pixels = static_cast<std::size_t>(out.width) * static_cast<std::size_t>(out.height);
  const bool depth = !faces.front().depth.empty();
  out.rgb.assign(3 * pixels, 0);
  out.alpha.assign(pixels, 0);
  if (depth) out.depth.assign(pixels, 0);
  for_samples([&](std::size_t pixel, const Ray& ray) {
    const auto index = static_cast<std::size_t>(face_of_axis_[axis_of(ray)]);
    const Undistortion& plan = plans_[index];
    const RenderedView& face = faces[index];
    const Ray r = rotated(plan.rotation, ray);
    const double column = r[0] / r[2] * plan.fx + plan.cx, row = r[1] / r[2] * plan.fy + plan.cy;
    constexpr float kPart = 1.0f / (kSamples * kSamples);
    add_sample(face.rgb, 3, face.width, face.height, column, row, kPart, &out.rgb[3 * pixel]);
    add_sample(face.alpha, 1, face.width, face.height, column, row, kPart, &out.alpha[pixel]);
    if (depth)
      add_sample(face.depth, 1, face.width, face.height, column, row,
                 kPart * static_cast<float>(length(r) / r[2]), &out.depth[pixel]);
  });
  return out;
}

}  // namespace ubs
