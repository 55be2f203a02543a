// SPDX-License-Identifier: Apache-2.0
// Lossless WebP images of four channels of 8 bits, by OpenCV.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace ubs {

struct Rgba8 {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgba;  // rows from the top
};

// Colours of pixels of alpha 0 may be lost.
std::vector<std::byte> encode_webp(const Rgba8& image);
// Of at most so many pixels. Lossy images are refused: these pixels are numbers. Error(data) starts with
// `name`.
Rgba8 decode_webp(std::span<const std::byte> bytes, std::size_t most_pixels, const std::string& name);

}  // namespace ubs
