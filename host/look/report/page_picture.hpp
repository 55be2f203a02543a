// SPDX-License-Identifier: Apache-2.0
// These functions make images for a page: data URIs, and colour images of errors, depth and alpha.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "host/scene/dataset.hpp"

namespace ubs {

// Returns an image as a data URI. If its longer side has more than `longest` pixels, the image is first
// reduced to that size (area mean). Then it is encoded as PNG. If the PNG has more than 64 KiB or more than
// `most_bytes` bytes, the image is encoded as JPEG instead. If the JPEG has more than `most_bytes` bytes, its
// quality is lowered step by step, down to 50 of 100. The JPEG of this quality is returned even if it is
// still too large.
std::string page_picture(const Image8& image, int longest, std::size_t most_bytes = SIZE_MAX);

// Returns an image of the errors |a - b|, which are averaged over the channels. The range from 0 to `top` is
// mapped to the colour map Inferno: black, purple, red, yellow. Larger errors have the colour of `top`.
// Throws Error(internal) if the sizes differ.
Image8 error_image(const Image8& a, const Image8& b, double top);

struct ValueRange {
  double low = 0, high = 1;
};
// Returns the range from the 1st to the 99th percentile of the depths of all pixels with an alpha of at least
// 0.5, or of all pixels if there is no such pixel. `depth` and `alpha` have the same size.
ValueRange central_depth_range(std::span<const float> depth, std::span<const float> alpha);
// Returns an image of the depth. Near pixels are bright; pixels with low alpha are darker.
Image8 depth_image(std::span<const float> depth, std::span<const float> alpha, int width, int height,
                   ValueRange range);
// Returns a grey image of values from 0 (black) to 1 (white).
Image8 grey_image(std::span<const float> values, int width, int height);

// Returns the PSNR of two 8-bit images in dB, as the mean of the PSNRs of their channels. It is infinite if a
// channel is equal in both images.
double psnr_channel_mean(const Image8& a, const Image8& b);

}  // namespace ubs
