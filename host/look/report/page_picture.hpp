// SPDX-License-Identifier: Apache-2.0
// Pictures inside of a page: pixels as data URIs, and colour maps for what is no colour (error, depth,
// alpha).
#pragma once

#include <span>
#include <string>

#include "host/scene/dataset.hpp"

namespace ubs {

// Returns a picture as a data URI: PNG where that is small, else JPEG. A picture whose longer side has more
// than `longest` pixels is reduced to that (area mean).
std::string page_picture(const Image8& image, int longest);

// Mean over the channels of |a - b|, 0 to `top`, from black over red and yellow to white. Throws
// Error(internal) for different sizes.
Image8 error_image(const Image8& a, const Image8& b, double top);

struct ValueRange {
  double low = 0, high = 1;
};
// From the 1st to the 99th hundredth of the depths where alpha is at least a half; all of them, where that is
// nowhere. `depth` and `alpha` are of one size.
ValueRange depth_range(std::span<const float> depth, std::span<const float> alpha);
// Near is bright; darkened by alpha.
Image8 depth_image(std::span<const float> depth, std::span<const float> alpha, int width, int height,
                   ValueRange range);
Image8 grey_image(std::span<const float> values, int width, int height);  // 0 to 1

// Means over the channels of the PSNR, of 8-bit images; infinite where a channel is equal.
double psnr_channel_mean(const Image8& a, const Image8& b);

}  // namespace ubs
