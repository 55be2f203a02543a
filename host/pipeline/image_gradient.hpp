// SPDX-License-Identifier: Apache-2.0
// From a gradient with respect to the pixels of the view drawn last, colours, alpha and depth, to that of the
// parameters.
#pragma once

#include <span>

#include "host/pipeline/renderer.hpp"

namespace ubs {

struct ImageGradient {           // empty: zeros
  std::span<const float> rgb;    // (height, width, 3)
  std::span<const float> alpha;  // (height, width)
  std::span<const float> depth;  // (height, width); needs KernelConfig::depth and depth_grad
  bool rgb_on_device = false;    // what Renderer::v_image() holds, in place of rgb; alpha is empty then
};

// After a forward pass for backward; the drawn image is changed, with depth the colours of the projected
// splats too. v_params, one a group, may be empty: as far as Renderer::backward_to_records() then.
//
// Back ends know a gradient of the colours alone. They walk through the splats of a pixel from the front and
// read what still comes behind from the image: v . (image - what has been passed), which ends with v .
// background times what is left of the light, T. With alpha = 1 - T the number v_rgb . image + v_alpha *
// alpha is one in which the last term is v_rgb . background - v_alpha: the gradient of a pixel in front of
// another background. So one channel of the image is changed by -v_alpha T / v before the walk. Where all of
// v_rgb is 0, or hardly more, one channel is set to 2^-30 of v_alpha: colours then get gradients of up to
// 1e-9 of v_alpha where they have none, far below the rounding of the rest.
//
// Depth has a pass of its own, in which z - z0 takes the place of red. Of D = sum w z / W with W = sum w =
// alpha the gradient is that of sum w (z - D) / W, with D and W held: that of an image of value D - z0 in
// front of the background D - z0, with v_D / W. z0, the mean depth, keeps the differences exact in scenes
// that are far away.
void backward_from_image(Device& device, Renderer& renderer, const ImageGradient& v,
                         std::span<const BufferView<float>> v_params);

}  // namespace ubs
