// SPDX-License-Identifier: Apache-2.0
// Image files in and out (image_codec.hpp decodes and encodes). Loading follows method.md 4.5: transparency is
// composited on the background and truncated to 8 bits at full size, then the image is reduced.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>

#include "host/scene/dataset.hpp"

namespace ubs {

struct ImageSize {
  int width = 0, height = 0;
  bool operator==(const ImageSize&) const = default;
};

// floor(size / factor + 0.5), at least 1.
int downscaled(int size, int factor);

// Size in the file, before any reduction. PNG: from its header; other formats are decoded.
ImageSize image_file_size(const std::filesystem::path& path);

// 8- or 16-bit grey, RGB or RGBA. 16-bit samples are converted with full precision: v / 65535 when
// composited, round(v / 257) otherwise. `original_size`, when given, receives the size in the file.
Image8 load_image(const std::filesystem::path& path, const std::array<double, 3>& background = {0, 0, 0},
                  int downscale = 1, ImageSize* original_size = nullptr);

// Clamped to [0,1], then rounded to 8 bits. NaN and infinity are an error, not a black pixel.
Image8 image_from_interleaved(std::span<const float> pixels, int width, int height);  // (H, W, 3)
Image8 image_from_planar(std::span<const float> pixels, int width, int height);       // (3, H, W)

void save_png(const std::filesystem::path& path, const Image8& image);
void save_png_interleaved(const std::filesystem::path& path, std::span<const float> pixels, int width,
                          int height);
void save_png_planar(const std::filesystem::path& path, std::span<const float> pixels, int width, int height);
// (H, W, 4), straight (not premultiplied) alpha.
void save_png_rgba(const std::filesystem::path& path, std::span<const std::uint8_t> rgba, int width,
                   int height);

}  // namespace ubs
