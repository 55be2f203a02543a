// SPDX-License-Identifier: Apache-2.0
// These functions load and save image files. Loading follows method.md 4.5: transparent pixels are composited
// on the background and truncated to 8 bits at full size. The caller reduces the image afterwards.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>

#include "host/base/file.hpp"
#include "host/scene/dataset.hpp"

namespace ubs {

struct ImageSize {
  int width = 0, height = 0;
  bool operator==(const ImageSize&) const = default;
};

// Maximum number of pixels of an image file that is decoded. OpenCV has the same limit.
inline constexpr std::size_t kMaxDecodedPixels = std::size_t{1} << 30;

inline std::size_t sample_count(int width, int height, int channels) {
  return static_cast<std::size_t>(width) * static_cast<std::size_t>(height) *
         static_cast<std::size_t>(channels);
}

// Returns floor(size / factor + 0.5), at least 1.
int downscaled(int size, int factor);

// Returns the size of the image as stored in the file, before any reduction (image_info.hpp).
ImageSize image_file_size(const std::filesystem::path& path);

// Loads an image without reducing it. The file may contain grey, RGB or RGBA pixels with 8 or 16 bits per
// sample, or floating-point samples (EXR), which are converted from linear light to sRGB. An image with an
// alpha channel is composited on the background in double precision before its samples are converted to 8
// bits. In an image without an alpha channel, a sample v with 16 bits becomes round(v / 257).
Image8 load_image(const std::filesystem::path& path, const std::array<double, 3>& background = {0, 0, 0});

// Loads a mask file with 8 or 16 bits as a grey image of the size of `image`. Its values are the alpha
// channel of the file, or the brightest colour channel if the file has no alpha channel or alpha is 1
// everywhere. The file may have another size than `image`, for example that of the full image if `image` is
// reduced. Throws Error(data) if the aspect ratios differ by more than 1 %.
Image8 load_mask_image(const std::filesystem::path& path, const Image8& image);
// Sets image.mask from a mask image that was undistorted and reduced like the image itself. A pixel is used
// if the value of the mask is at least 128.
void set_mask(Image8& image, const Image8& mask);

// Makes an image from (H, W, 3) float samples, which are clamped to [0, 1] and rounded to 8 bits. Throws if a
// sample is not finite.
Image8 image_from_interleaved(std::span<const float> pixels, int width, int height);

void save_png(const std::filesystem::path& path, const Image8& image, FileUse use = FileUse::result);
void save_png_interleaved(const std::filesystem::path& path, std::span<const float> pixels, int width,
                          int height);
// Writes (H, W, 4) pixels with straight (not premultiplied) alpha.
void save_png_rgba(const std::filesystem::path& path, std::span<const std::uint8_t> rgba, int width,
                   int height);

}  // namespace ubs
