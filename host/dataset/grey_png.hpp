// SPDX-License-Identifier: Apache-2.0
// These functions write single-channel PNG images for viewing: opacity masks (8 bit) and depth maps (16 bit).
#pragma once

#include <filesystem>
#include <span>

namespace ubs {

// GreyRange holds the values that the darkest and the brightest grey of an image stand for.
struct GreyRange {
  float low = 0, high = 0;
};

// Writes an image of (H, W) values, which are clamped to [0, 1] and rounded to 8 bits.
void save_png_grey8(const std::filesystem::path& path, std::span<const float> pixels, int width, int height);

// Writes an image of (H, W) values with 16 bits per pixel. Their minimum is mapped to 0 and their maximum to
// 65535. Returns the minimum and the maximum. A constant image becomes black.
GreyRange save_png_grey16(const std::filesystem::path& path, std::span<const float> pixels, int width,
                          int height);

}  // namespace ubs
