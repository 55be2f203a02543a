// SPDX-License-Identifier: Apache-2.0
// ImageBackward converts a gradient with respect to the pixels of the last rendered view (colour, alpha and
// depth) into the gradient with respect to the parameters.
#pragma once

#include <span>

#include "host/pipeline/renderer.hpp"

namespace ubs {

// ImageGradient holds the gradients with respect to the pixels. Each of them is in host memory (the span), or
// in device memory (the flag is set, and the values are in Renderer::v_image(), ImageBackward::v_alpha() or
// ImageBackward::v_depth()), or 0 (neither).
struct ImageGradient {
  std::span<const float> rgb;    // (height, width, 3)
  std::span<const float> alpha;  // (height, width)
  std::span<const float> depth;  // (height, width); needs KernelConfig::depth and depth_grad
  bool rgb_on_device = false, alpha_on_device = false, depth_on_device = false;
  // Further channels, whose gradients have an effect on the positions, shapes and opacities of the splats.
  // Only with KernelConfig::absgrad, and not together with depth.
  std::uint32_t more_channels = 0;
  std::span<const float> more;          // (height, width, more_channels)
  std::span<const float> more_image;    // the same shape: these channels of the image, without a background
  std::span<const float> more_colours;  // (splats of all groups, more_channels)

  bool has_alpha() const { return alpha_on_device || !alpha.empty(); }
  bool has_depth() const { return depth_on_device || !depth.empty(); }
};

// Alpha: back ends only support a gradient with respect to colours. They process the splats of a pixel from
// front to back. At each splat they compute the contribution of everything behind it from the image, as
// v_rgb . (image - c), where c is the colour that has been composited so far. After the last splat,
// T (v_rgb . background) remains, where T is the transmittance. We need the gradient of
// v_rgb . image + v_alpha * alpha. Because alpha is 1 - T, v_alpha adds a constant and changes this remainder
// by -v_alpha T, as a different background would. Before the backward pass, we therefore change one channel
// of the image by -v_alpha T / v, where v is the component of v_rgb in this channel. If all components of
// v_rgb are 0 or nearly 0, one of them is set to 2^-30 of v_alpha. Colours then get gradients of up to 1e-9
// of v_alpha that should be 0, which is far below the rounding of the other gradients.
//
// Depth: its gradient is computed in a separate pass, in which z - z0 replaces the red channel. Here z is the
// depth of a splat, w is its weight in the pixel, and z0 is the mean depth of the image. The depth of a pixel
// is D = sum w z / W with W = sum w = alpha. Its gradient equals that of sum w (z - D) / W, where D and W are
// held constant. In the pass, this is the gradient v_D / W of an image with the value D - z0 in front of the
// background D - z0. Subtracting z0 keeps the differences precise in scenes that are far away from the
// camera. The green channel of the pass is W.
class ImageBackward {
 public:
  // The class uses stages that do not depend on the variant, so `stages` may be any stages of the device.
  ImageBackward(Device& device, Stages& stages, Renderer& renderer)
      : device_(device), stages_(stages), renderer_(renderer) {}

  // Return a buffer (rows, pitch) for a view of this size, filled with zeros.
  BufferView<float> v_alpha(const ImageShape& shape) { return zeros(v_alpha_, shape); }
  BufferView<float> v_depth(const ImageShape& shape) { return zeros(v_depth_, shape); }
  BufferView<float> v_alpha() const { return v_alpha_.view(); }
  BufferView<float> v_depth() const { return v_depth_.view(); }

  // The last forward pass of the renderer must have been called with for_backward = true. v_params has one
  // buffer per group. If v_params is empty, the function only computes the gradient of the projected splats,
  // Renderer::v_records().
  //
  // The function may overwrite Renderer::v_image(). If there is a gradient of alpha or depth, it overwrites
  // the rendered image, and if there is one of depth, the colours of the projected splats.
  void run(const ImageGradient& v, std::span<const BufferView<float>> v_params);

 private:
  BufferView<float> zeros(Buffer<float>& buffer, const ImageShape& shape);
  void colours_to_records(const ImageGradient& v);
  MoreChannels upload_more(const ImageGradient& v);
  void depth_to_records(const ImageGradient& v);

  Device& device_;
  Stages& stages_;
  Renderer& renderer_;
  Buffer<float> v_alpha_, v_depth_, mean_, more_colours_, v_more_;
  Buffer<float> earlier_;  // v_records of colours and alpha, while those of depth are computed
};

}  // namespace ubs
