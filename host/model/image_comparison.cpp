// SPDX-License-Identifier: Apache-2.0
#include "host/model/image_comparison.hpp"

#include <algorithm>
#include <cmath>

#include "host/base/error.hpp"
#include "host/device/registry.hpp"

namespace ubs {
namespace {

// The factor that converts 8-bit values to the range 0 to 1. The kernels multiply the reference image by the
// same float. Therefore equal images give bit-identical values, and an infinite PSNR.
constexpr float kUnit = 0.00392156862745098f;

// Converts an image of shape (height, width, 3) to three planes with `rows` rows of `pitch` values each. The
// padding on the right and at the bottom is 0. `change` is applied to every value.
template <typename To, typename From, typename Change>
std::vector<To> planes(std::span<const From> image, int width, int height, int pitch, int rows,
                       const Change& change) {
  std::vector<To> values(3ull * static_cast<std::size_t>(pitch) * static_cast<std::size_t>(rows));
  for (int c = 0; c < 3; ++c)
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        values[(static_cast<std::size_t>(c) * static_cast<std::size_t>(rows) + static_cast<std::size_t>(y)) *
                   static_cast<std::size_t>(pitch) +
               static_cast<std::size_t>(x)] =
            change(image[3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                              static_cast<std::size_t>(x)) +
                         static_cast<std::size_t>(c)]);
  return values;
}

float clamped(float value) { return std::clamp(value, 0.0f, 1.0f); }

void check_finite(std::span<const float> image, const char* what) {
  if (!std::ranges::all_of(image, [](float v) { return std::isfinite(v); }))
    fail(ErrorKind::numerical, "{} contains values that are not finite", what);
}

void check_pixels(const std::string& name, int width, int height) {
  if (std::int64_t{width} * height > kMaxPixels)
    fail(ErrorKind::data, "{}: {}x{} pixels are too many to compare: images can have at most {}", name, width,
         height, kMaxPixels);
}

}  // namespace

ImageComparison::ImageComparison(Device& device, const LpipsRequest& request)
    : device_(device),
      stages_(make_stages(device, {.dim = 3, .raster = raster_kind("auto", device.info())})),
      more_(device, request),
      sums_(device, "metric sums", 8) {}

template <typename T>
Buffer<T> ImageComparison::upload(const std::vector<T>& values) {
  Buffer<T> buffer(device_, "image", values.size());
  buffer.upload(values);
  return buffer;
}

ViewMetrics ImageComparison::measure(const std::string& name, const ImageShape& shape,
                                     std::span<const float> image, BufferView<std::uint8_t> bytes,
                                     BufferView<float> values, const DeviceImage& truth) {
  const PlanarSize size{shape.width, shape.height};
  more_.check_size(size);
  const auto drawn = upload(std::vector<float>(image.begin(), image.end()));
  stages_->image_loss({.shape = shape,
                       .image = drawn.view(),
                       .target = bytes,
                       .target_float = values,
                       .clamp = true,
                       .v_image = {},
                       .sums = sums_.view()});
  ViewMetrics metrics = view_metrics(name, std::span<const float, 8>(sums_.download()));
  const DeviceImage a{.size = size, .values = drawn.view(), .pitch = shape.pitch(), .rows = shape.rows()};
  metrics.ssim_valid = more_.valid_ssim(a, truth);
  metrics.lpips = more_.lpips(a, truth);
  return metrics;
}

ViewMetrics ImageComparison::measure(const std::string& name, const Image8& truth, const Image8& image) {
  check_pixels(name, image.width, image.height);
  const ImageShape shape{image.width, image.height};
  const auto values =
      planes<float>(std::span(image.rgb), image.width, image.height, shape.pitch(), shape.rows(),
                    [](std::uint8_t v) { return static_cast<float>(v) * kUnit; });
  const auto target =
      upload(planes<std::uint8_t>(std::span(truth.rgb), truth.width, truth.height, truth.width, truth.height,
                                  [](std::uint8_t v) { return v; }));
  return measure(name, shape, values, target.view(), {},
                 {.size = {truth.width, truth.height}, .bytes = target.view()});
}

ViewMetrics ImageComparison::measure(const std::string& name, int width, int height,
                                     std::span<const float> truth, std::span<const float> image) {
  check_pixels(name, width, height);
  check_finite(truth, "the reference image");
  check_finite(image, "the image");
  const ImageShape shape{width, height};
  const auto values = planes<float>(image, width, height, shape.pitch(), shape.rows(), clamped);
  const auto target = upload(planes<float>(truth, width, height, width, height, clamped));
  // The LPIPS networks read planes with padding.
  const auto padded = upload(planes<float>(truth, width, height, shape.pitch(), shape.rows(), clamped));
  return measure(
      name, shape, values, {}, target.view(),
      {.size = {width, height}, .values = padded.view(), .pitch = shape.pitch(), .rows = shape.rows()});
}

}  // namespace ubs
