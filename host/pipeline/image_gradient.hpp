// SPDX-License-Identifier: Apache-2.0
// From a gradient with respect to the pixels of the view drawn last, colours and alpha, to that of the
// parameters.
#pragma once

#include <span>

#include "host/pipeline/renderer.hpp"

namespace ubs {

// v_rgb: (height, width, 3), v_alpha: (height, width); either may be empty: zeros. After a forward pass for
// backward; the drawn image is changed.
//
// Back ends know a gradient of the colours alone. They walk through the splats of a pixel from the front and
// read what still comes behind from the image: v . (image - what has been passed), which ends with v .
// background times what is left of the light, T. With alpha = 1 - T the number v_rgb . image + v_alpha *
// alpha is one in which the last term is v_rgb . background - v_alpha: the gradient of a pixel in front of
// another background. So one channel of the image is changed by -v_alpha T / v before the walk. Where all of
// v_rgb is 0, or hardly more, one channel is set to 2^-30 of v_alpha: colours then get gradients of up to
// 1e-9 of v_alpha where they have none, far below the rounding of the rest.
void backward_from_image(Device& device, Renderer& renderer, std::span<const float> v_rgb,
                         std::span<const float> v_alpha, std::span<const View1<float>> v_params);

}  // namespace ubs
