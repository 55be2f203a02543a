// SPDX-License-Identifier: Apache-2.0
// masked_valid_ssim() and fill_masked() are the parts of the image metrics for views with masks. They run on
// the host: masks are rare in evaluation, and a host loop is simpler than a second version of every kernel.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "host/device/metric_ops.hpp"

namespace ubs {

// Returns the mean SSIM over the three channels and over all 11 x 11 windows that are inside the image and
// contain no pixel with mask 0. Returns nothing if there is no such window. a, b: (3, height, width); mask:
// (height, width).
std::optional<double> masked_valid_ssim(std::span<const float> a, std::span<const float> b,
                                        std::span<const std::uint8_t> mask, PlanarSize size);

// Returns `image` with the pixels of `other` where the mask is 0, so that the two images are equal there and
// LPIPS only measures differences in the other pixels.
std::vector<float> fill_masked(std::span<const float> image, std::span<const float> other,
                               std::span<const std::uint8_t> mask);

}  // namespace ubs
