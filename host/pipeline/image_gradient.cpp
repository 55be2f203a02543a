// SPDX-License-Identifier: Apache-2.0
#include "host/pipeline/image_gradient.hpp"

#include <cmath>
#include <vector>

#include "host/base/error.hpp"

namespace ubs {
namespace {

constexpr float kLeastShare = 0x1p-30f;  // of v_alpha, in v_rgb

std::vector<float> download(Device& device, View1<float> view, std::size_t size) {
  std::vector<float> values(size);
  device.read(*view.memory, 0, std::as_writable_bytes(std::span(values)));
  return values;
}

void upload(Device& device, View1<float> view, const std::vector<float>& values) {
  device.write(*view.memory, 0, std::as_bytes(std::span(values)));
}

}  // namespace

void backward_from_image(Device& device, Renderer& renderer, std::span<const float> v_rgb,
                         std::span<const float> v_alpha, std::span<const View1<float>> v_params) {
  const ImageShape shape = renderer.shape();
  const auto width = static_cast<std::size_t>(shape.width), height = static_cast<std::size_t>(shape.height);
  const auto pitch = static_cast<std::size_t>(shape.pitch());
  const std::size_t plane = shape.plane();
  if ((!v_rgb.empty() && v_rgb.size() != 3 * width * height) ||
      (!v_alpha.empty() && v_alpha.size() != width * height))
    fail(ErrorKind::internal, "gradients of {} colours and {} alphas for {}x{} pixels", v_rgb.size(),
         v_alpha.size(), width, height);
  std::vector<float> v_image(3 * plane);
  for (std::size_t y = 0; y < height && !v_rgb.empty(); ++y)
    for (std::size_t x = 0; x < width; ++x)
      for (std::size_t c = 0; c < 3; ++c) v_image[c * plane + y * pitch + x] = v_rgb[3 * (y * width + x) + c];
  if (!v_alpha.empty()) {
    const RasterForward drawn = renderer.last_lists();
    const std::vector<float> left = download(device, drawn.transmittance, plane);
    std::vector<float> image = download(device, drawn.image, 3 * plane);
    for (std::size_t y = 0; y < height; ++y)
      for (std::size_t x = 0; x < width; ++x) {
        const float v = v_alpha[y * width + x];
        const std::size_t at = y * pitch + x;
        if (v == 0) continue;
        std::size_t most = at;
        for (std::size_t c = 1; c < 3; ++c)
          if (std::abs(v_image[c * plane + at]) > std::abs(v_image[most])) most = c * plane + at;
        if (std::abs(v_image[most]) < kLeastShare * std::abs(v)) v_image[most] = kLeastShare * v;
        image[most] -= v * left[at] / v_image[most];
      }
    upload(device, drawn.image, image);
  }
  upload(device, renderer.v_image(), v_image);
  renderer.backward(v_params, false);
}

}  // namespace ubs
