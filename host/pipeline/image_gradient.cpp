// SPDX-License-Identifier: Apache-2.0
#include "host/pipeline/image_gradient.hpp"

#include <numeric>
#include <vector>

#include "host/base/error.hpp"
#include "kernels/layout.h"

namespace ubs {
namespace {

// Writes an image (height, width, channels) to the planes of a buffer, and 0 beyond the image.
void upload(Device& device, const BufferView<float>& to, std::span<const float> values, std::size_t channels,
            const ImageShape& shape) {
  const auto width = static_cast<std::size_t>(shape.width), height = static_cast<std::size_t>(shape.height);
  std::vector<float> planes(channels * shape.plane());
  for (std::size_t y = 0; y < height; ++y)
    for (std::size_t x = 0; x < width; ++x)
      for (std::size_t c = 0; c < channels; ++c)
        planes[c * shape.plane() + y * static_cast<std::size_t>(shape.pitch()) + x] =
            values[channels * (y * width + x) + c];
  device.write(*to.memory, 0, std::as_bytes(std::span(planes)));
}

}  // namespace

BufferView<float> ImageBackward::zeros(Buffer<float>& buffer, const ImageShape& shape) {
  reserve(device_, buffer, "image gradient", shape.plane());
  buffer.zero();
  return buffer.view();
}

MoreChannels ImageBackward::upload_more(const ImageGradient& v) {
  if (v.more_channels == 0) return {};
  const ImageShape shape = renderer_.shape();
  const std::size_t channels = v.more_channels, pixels = v.more.size() / channels;
  std::vector<float> values;  // for each pixel the first plane of RasterBackward::v_more, and then the others
  values.reserve((1 + channels) * pixels);
  for (std::size_t pixel = 0; pixel < pixels; ++pixel) {
    const auto of_pixel = v.more.subspan(pixel * channels, channels);
    const auto image = v.more_image.subspan(pixel * channels, channels);
    values.push_back(std::inner_product(of_pixel.begin(), of_pixel.end(), image.begin(), 0.0f));
    values.insert(values.end(), of_pixel.begin(), of_pixel.end());
  }
  reserve(device_, v_more_, "image gradient", (1 + channels) * shape.plane());
  upload(device_, v_more_.view(), values, 1 + channels, shape);
  reserve(device_, more_colours_, "further channels", v.more_colours.size());
  device_.write(*more_colours_.view().memory, 0, std::as_bytes(v.more_colours));
  return {more_colours_.view(), v_more_.view(), static_cast<int>(channels)};
}

void ImageBackward::colours_to_records(const ImageGradient& v) {
  const ImageShape shape = renderer_.shape();
  if (!v.rgb.empty())
    upload(device_, renderer_.v_image(), v.rgb, 3, shape);
  else if (!v.rgb_on_device)
    renderer_.v_image(shape);  // fills it with zeros
  if (v.has_alpha()) {
    if (!v.alpha.empty()) {
      reserve(device_, v_alpha_, "image gradient", shape.plane());
      upload(device_, v_alpha_.view(), v.alpha, 1, shape);
    }
    stages_.alpha_to_colours({.shape = shape,
                              .v_alpha = v_alpha(),
                              .transmittance = renderer_.transmittance(),
                              .image = renderer_.image(),
                              .v_image = renderer_.v_image()});
  }
  renderer_.backward_to_records(upload_more(v));
}

void ImageBackward::depth_to_records(const ImageGradient& v) {
  const ImageShape shape = renderer_.shape();
  const BufferView<float> v_records = renderer_.v_records();
  const auto count = static_cast<std::uint32_t>(v_records.size / kGradStride);
  const bool adds = v.rgb_on_device || !v.rgb.empty() || v.has_alpha();
  if (adds) {
    colours_to_records(v);
    reserve(device_, earlier_, "gradients of colours", v_records.size);
    device_.copy(*v_records.memory, 0, *earlier_.view().memory, 0, v_records.size * sizeof(float));
  }
  if (!v.depth.empty()) {
    reserve(device_, v_depth_, "image gradient", shape.plane());
    upload(device_, v_depth_.view(), v.depth, 1, shape);
  }
  reserve(device_, mean_, "mean depth", 1);
  stages_.depth_to_records({.shape = shape,
                            .depth = renderer_.depth(),
                            .v_depth = v_depth(),
                            .count = count,
                            .mean = mean_.view(),
                            .records = renderer_.records()});
  renderer_.draw_again();
  stages_.depth_to_image({.shape = shape,
                          .depth = renderer_.depth(),
                          .v_depth = v_depth(),
                          .mean = mean_.view(),
                          .image = renderer_.image(),
                          .v_image = renderer_.v_image()});
  renderer_.backward_to_records();
  stages_.depth_from_records(
      {.count = count, .earlier = adds ? earlier_.view() : BufferView<float>{}, .v_records = v_records});
}

void ImageBackward::run(const ImageGradient& v, std::span<const BufferView<float>> v_params) {
  const ImageShape shape = renderer_.shape();
  const std::size_t pixels = static_cast<std::size_t>(shape.width) * static_cast<std::size_t>(shape.height);
  if ((!v.rgb.empty() && v.rgb.size() != 3 * pixels) || (!v.alpha.empty() && v.alpha.size() != pixels) ||
      (!v.depth.empty() && v.depth.size() != pixels))
    fail(ErrorKind::internal, "gradients of {} colours, {} alphas and {} depths do not match {}x{} pixels",
         v.rgb.size(), v.alpha.size(), v.depth.size(), shape.width, shape.height);
  const std::size_t splats = renderer_.records().size / kSplatStride;
  if (v.more.size() != v.more_channels * pixels || v.more_image.size() != v.more.size() ||
      v.more_colours.size() != v.more_channels * splats || (v.more_channels > 0 && v.has_depth()))
    fail(ErrorKind::internal, "gradients of {} further channels do not match {}x{} pixels and {} splats",
         v.more_channels, shape.width, shape.height, splats);
  if (v.has_depth())
    depth_to_records(v);
  else
    colours_to_records(v);
  if (!v_params.empty()) renderer_.backward_from_records(v_params, false);
}

}  // namespace ubs
