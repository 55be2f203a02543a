// SPDX-License-Identifier: Apache-2.0
// Single-channel images: opacity masks (8 bit) and depth maps (16 bit) for looking at.
#pragma once

#include <filesystem>
#include <span>

namespace ubs {

struct GreyRange {
  float low = 0, high = 0;
};

// (H, W) clamped to [0, 1] and rounded to 8 bits.
void save_png_grey8(const std::filesystem::path& path, std::span<const float> pixels, int width, int height);

// (H, W) with the range of the image mapped to 0 .. 65535; returns that range. A constant image is black.
GreyRange save_png_grey16(const std::filesystem::path& path, std::span<const float> pixels, int width,
                          int height);

}  // namespace ubs
