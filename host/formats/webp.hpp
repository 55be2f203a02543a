// SPDX-License-Identifier: Apache-2.0
// encode_webp() and decode_webp() write and read lossless WebP images with four channels of 8 bits, using
// OpenCV.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace ubs {

struct Rgba8 {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgba;  // rows from top to bottom
};

// Returns the contents of a WebP file. The colours of pixels with alpha 0 may be lost.
std::vector<std::byte> encode_webp(const Rgba8& image);
// Decodes an image. Throws Error(data) with a message that starts with `name` if the image is damaged, if it
// has more than `most_pixels` pixels, or if it is lossy, because the pixels encode data. (A lossy image with
// an extended header is not recognised as lossy.)
Rgba8 decode_webp(std::span<const std::byte> bytes, std::size_t most_pixels, const std::string& name);

}  // namespace ubs
