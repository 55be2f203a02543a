// SPDX-License-Identifier: Apache-2.0
#include "host/pipeline/image_gradient.hpp"

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
  renderer_.backward_to_records();
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
  if (v.has_depth())
    depth_to_records(v);
  else
    colours_to_records(v);
  if (!v_params.empty()) renderer_.backward_from_records(v_params, false);
}

}  // namespace ubs
