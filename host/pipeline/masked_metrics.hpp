// SPDX-License-Identifier: Apache-2.0
// The image metrics of views with masks that no kernel has: masks are rare in evaluation, and a host loop
// costs less than a second form of every kernel.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "host/device/metric_ops.hpp"

namespace ubs {

// SSIM over the 11 x 11 windows that lie in the image and hold no pixel whose mask is 0, mean over them and
// three channels; nothing where there is none. a, b: (3, height, width); mask: (height, width).
std::optional<double> masked_valid_ssim(std::span<const float> a, std::span<const float> b,
                                        std::span<const std::uint8_t> mask, PlanarSize size);

// `image` with the pixels of `other` where the mask is 0: what a network sees of it then is no difference.
std::vector<float> fill_masked(std::span<const float> image, std::span<const float> other,
                               std::span<const std::uint8_t> mask);

}  // namespace ubs
