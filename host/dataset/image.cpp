// SPDX-License-Identifier: Apache-2.0
// See image.hpp.
#include "host/dataset/image.hpp"

#include <algorithm>
#include <cmath>

#include "host/base/error.hpp"
#include "host/dataset/png.hpp"

namespace ubs {

namespace {

std::uint8_t quantise(float value, std::size_t index) {
  if (!std::isfinite(value))
    fail(ErrorKind::numerical, "sample {} of the image is {}, which is not finite", index, value);
  return static_cast<std::uint8_t>(std::clamp(value, 0.0f, 1.0f) * 255.0f + 0.5f);
}

void check_samples(std::size_t found, int width, int height, int channels) {
  if (width < 1 || height < 1 || found != sample_count(width, height, channels))
    fail(ErrorKind::internal, "an image of {}x{} pixels with {} channels cannot be made of {} samples", width,
         height, channels, found);
}

}  // namespace

int downscaled(int size, int factor) {
  if (factor < 1) fail(ErrorKind::usage, "downscale factor {} is not supported: choose 1 or more", factor);
  return std::max(1, static_cast<int>(std::floor(static_cast<double>(size) / factor + 0.5)));
}

void set_mask(Image8& image, const Image8& mask) {
  if (mask.rgb.size() != image.rgb.size())
    fail(ErrorKind::internal, "the mask has {}x{} pixels, but the image has {}x{}", mask.width, mask.height,
         image.width, image.height);
  image.mask.resize(mask.rgb.size() / 3);
  for (std::size_t i = 0; i < image.mask.size(); ++i) image.mask[i] = mask.rgb[3 * i] >= 128 ? 255 : 0;
}

Image8 image_from_interleaved(std::span<const float> pixels, int width, int height) {
  check_samples(pixels.size(), width, height, 3);
  Image8 image{width, height, std::vector<std::uint8_t>(pixels.size())};
  for (std::size_t i = 0; i < pixels.size(); ++i) image.rgb[i] = quantise(pixels[i], i);
  return image;
}

void save_png(const std::filesystem::path& path, const Image8& image, FileUse use) {
  check_samples(image.rgb.size(), image.width, image.height, 3);
  write_png(path, {image.width, image.height, 3}, image.rgb.data(), use);
}

void save_png_interleaved(const std::filesystem::path& path, std::span<const float> pixels, int width,
                          int height) {
  save_png(path, image_from_interleaved(pixels, width, height));
}

void save_png_rgba(const std::filesystem::path& path, std::span<const std::uint8_t> rgba, int width,
                   int height) {
  check_samples(rgba.size(), width, height, 4);
  write_png(path, {width, height, 4}, rgba.data());
}

}  // namespace ubs
