// SPDX-License-Identifier: Apache-2.0
#include "host/pipeline/image_gradient.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "host/base/error.hpp"
#include "kernels/layout.h"

namespace ubs {
namespace {

constexpr float kFaintest = 1e-6f;     // minimum alpha of pixels whose depth has a gradient
constexpr float kMinShare = 0x1p-30f;  // minimum of |v_rgb| relative to |v_alpha|

void upload(Device& device, BufferView<float> view, const std::vector<float>& values) {
  device.write(*view.memory, 0, std::as_bytes(std::span(values)));
}

// Calls `visit` for each pixel of the image. The first argument is the index of the pixel in the caller's
// arrays, the second its index in a padded plane of the renderer's buffers.
template <typename Visit>
void for_pixels(const ImageShape& shape, const Visit& visit) {
  const auto width = static_cast<std::size_t>(shape.width), height = static_cast<std::size_t>(shape.height);
  for (std::size_t y = 0; y < height; ++y)
    for (std::size_t x = 0; x < width; ++x)
      visit(y * width + x, y * static_cast<std::size_t>(shape.pitch()) + x);
}

void colours_to_records(Device& device, Renderer& renderer, const ImageGradient& v) {
  if (v.rgb_on_device) return renderer.backward_to_records();
  const ImageShape shape = renderer.shape();
  const std::size_t plane = shape.plane();
  std::vector<float> v_image(3 * plane);
  if (!v.rgb.empty())
    for_pixels(shape, [&](std::size_t pixel, std::size_t at) {
      for (std::size_t c = 0; c < 3; ++c) v_image[c * plane + at] = v.rgb[3 * pixel + c];
    });
  if (!v.alpha.empty()) {
    const RasterForward drawn = renderer.last_lists();
    const std::vector<float> left = read_values(device, drawn.transmittance, plane);
    std::vector<float> image = read_values(device, drawn.image, 3 * plane);
    for_pixels(shape, [&](std::size_t pixel, std::size_t at) {
      const float v_alpha = v.alpha[pixel];
      if (v_alpha == 0) return;
      std::size_t most = at;
      for (std::size_t c = 1; c < 3; ++c)
        if (std::abs(v_image[c * plane + at]) > std::abs(v_image[most])) most = c * plane + at;
      if (std::abs(v_image[most]) < kMinShare * std::abs(v_alpha)) v_image[most] = kMinShare * v_alpha;
      image[most] -= v_alpha * left[at] / v_image[most];
    });
    upload(device, drawn.image, image);
  }
  upload(device, renderer.v_image(), v_image);
  renderer.backward_to_records();
}

void depth_to_records(Device& device, Renderer& renderer, std::span<const float> v_depth) {
  const ImageShape shape = renderer.shape();
  const std::size_t plane = shape.plane();
  const RasterForward drawn = renderer.last_lists();
  const std::vector<float> depth = read_values(device, drawn.depth, plane);
  double sum = 0, count = 0;
  for_pixels(shape, [&](std::size_t pixel, std::size_t at) {
    if (v_depth[pixel] == 0 || depth[at] == 0) return;
    sum += depth[at], count += 1;
  });
  const float origin = count > 0 ? static_cast<float>(sum / count) : 0.0f;
  const std::size_t rows = renderer.v_records().size / kGradStride;
  std::vector<float> records = read_values(device, drawn.records, rows * kSplatStride);
  for (std::size_t i = 0; i < rows; ++i) {
    float* record = records.data() + i * kSplatStride;
    record[kSplatR] = record[kSplatDepth] - origin;
    record[kSplatG] = 1;
    record[kSplatB] = 0;
  }
  upload(device, drawn.records, records);
  // The green channel of the image becomes W, the sum of the weights (see the header). We cannot use 1 -
  // transmittance instead, because its rounding errors are too large for pixels with a small alpha, and these
  // pixels have a depth too.
  renderer.draw_again();
  const std::vector<float> drawn_again = read_values(device, drawn.image, 3 * plane);
  std::vector<float> v_image(3 * plane), image(3 * plane);
  for_pixels(shape, [&](std::size_t pixel, std::size_t at) {
    const float weight = drawn_again[plane + at];
    if (!(weight > kFaintest)) return;
    image[at] = depth[at] - origin;
    v_image[at] = v_depth[pixel] / weight;
  });
  upload(device, drawn.image, image);
  upload(device, renderer.v_image(), v_image);
  renderer.backward_to_records();
}

// Moves the gradient that the depth pass has stored in the red channel to the depth of each projected splat.
// Then adds `before`, the gradient of the projected splats that comes from colours and alpha.
void join(Device& device, BufferView<float> v_records, const std::vector<float>& before) {
  std::vector<float> values = read_values(device, v_records, v_records.size);
  for (std::size_t i = 0; i + kGradStride <= values.size(); i += kGradStride) {
    values[i + kGradDepth] = values[i + kGradR];
    values[i + kGradR] = values[i + kGradG] = values[i + kGradB] = 0;
    for (std::size_t k = 0; k <= kGradB && !before.empty(); ++k) values[i + k] += before[i + k];
  }
  upload(device, v_records, values);
}

}  // namespace

void backward_from_image(Device& device, Renderer& renderer, const ImageGradient& v,
                         std::span<const BufferView<float>> v_params) {
  const ImageShape shape = renderer.shape();
  const std::size_t pixels = static_cast<std::size_t>(shape.width) * static_cast<std::size_t>(shape.height);
  if ((!v.rgb.empty() && v.rgb.size() != 3 * pixels) || (!v.alpha.empty() && v.alpha.size() != pixels) ||
      (!v.depth.empty() && v.depth.size() != pixels))
    fail(ErrorKind::internal, "gradients of {} colours, {} alphas and {} depths do not match {}x{} pixels",
         v.rgb.size(), v.alpha.size(), v.depth.size(), shape.width, shape.height);
  std::vector<float> before;
  if (v.depth.empty() || v.rgb_on_device || !v.rgb.empty() || !v.alpha.empty()) {
    colours_to_records(device, renderer, v);
    if (!v.depth.empty()) before = read_values(device, renderer.v_records(), renderer.v_records().size);
  }
  if (!v.depth.empty()) {
    depth_to_records(device, renderer, v.depth);
    join(device, renderer.v_records(), before);
  }
  if (!v_params.empty()) renderer.backward_from_records(v_params, false);
}

}  // namespace ubs
