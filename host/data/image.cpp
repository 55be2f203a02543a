// SPDX-License-Identifier: Apache-2.0
// See image.hpp.
#include "host/data/image.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/data/image_codec.hpp"
#include "host/data/resample.hpp"

namespace ubs {

namespace {

std::size_t sample_count(int width, int height, int channels) {
  return static_cast<std::size_t>(width) * static_cast<std::size_t>(height) *
         static_cast<std::size_t>(channels);
}

std::uint8_t to_8_bit(std::uint8_t v) { return v; }
std::uint8_t to_8_bit(std::uint16_t v) { return static_cast<std::uint8_t>((v + 128) / 257); }

// Double precision reproduces the published arithmetic: v / 255 * 255
// truncates back to v for every v (checked), so opaque pixels keep their value.
template <typename Sample>
Image8 composite(const RawImage& image, const std::array<double, 3>& background) {
  constexpr double kMax = std::numeric_limits<Sample>::max();
  const int channels = image.channels;
  Image8 result{image.width, image.height, {}};
  result.rgb.resize(sample_count(image.width, image.height, 3));
  const Sample* in = image.samples<Sample>();
  for (auto out = result.rgb.begin(); out != result.rgb.end(); in += channels)
    for (int c = 0; c < 3; ++c) {
      const Sample value = channels == 1 ? in[0] : in[c];
      if (channels < 4) {
        *out++ = to_8_bit(value);
        continue;
      }
      const double alpha = in[3] / kMax;
      const double mixed = value / kMax * alpha + background[static_cast<std::size_t>(c)] * (1.0 - alpha);
      *out++ = static_cast<std::uint8_t>(std::clamp(mixed * 255.0, 0.0, 255.0));
    }
  return result;
}

std::uint8_t quantise(float value, std::size_t index) {
  if (!std::isfinite(value)) fail(ErrorKind::numerical, "image sample {} is {}", index, value);
  return static_cast<std::uint8_t>(std::clamp(value, 0.0f, 1.0f) * 255.0f + 0.5f);
}

void check_samples(std::size_t found, int width, int height, int channels) {
  if (width < 1 || height < 1 || found != sample_count(width, height, channels))
    fail(ErrorKind::internal, "image {}x{} with {} channels from {} samples", width, height, channels, found);
}

}  // namespace

int downscaled(int size, int factor) {
  if (factor < 1) fail(ErrorKind::usage, "downscale factor {} is not supported: choose 1 or more", factor);
  return std::max(1, static_cast<int>(std::floor(static_cast<double>(size) / factor + 0.5)));
}

ImageSize image_file_size(const std::filesystem::path& path) {
  std::size_t size = 0;
  std::ifstream stream = open_for_reading(path, size);
  unsigned char head[24] = {};
  stream.read(reinterpret_cast<char*>(head), sizeof head);
  constexpr unsigned char kPng[] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  if (stream && std::memcmp(head, kPng, sizeof kPng) == 0 && std::memcmp(head + 12, "IHDR", 4) == 0) {
    const auto big_endian = [&](int at) {
      return head[at] << 24 | head[at + 1] << 16 | head[at + 2] << 8 | head[at + 3];
    };
    const ImageSize found{big_endian(16), big_endian(20)};
    if (found.width < 1 || found.height < 1) fail(ErrorKind::data, "{}: damaged PNG header", path.string());
    return found;
  }
  const RawImage image = decode_image(path);
  return {image.width, image.height};
}

Image8 load_image(const std::filesystem::path& path, const std::array<double, 3>& background, int downscale,
                  ImageSize* original_size) {
  const RawImage decoded = decode_image(path);
  if (original_size) *original_size = {decoded.width, decoded.height};
  const Image8 full = decoded.wide ? composite<std::uint16_t>(decoded, background)
                                   : composite<std::uint8_t>(decoded, background);
  const int width = downscaled(full.width, downscale), height = downscaled(full.height, downscale);
  if (width == full.width && height == full.height) return full;
  return resize_bicubic(full, width, height);
}

Image8 image_from_interleaved(std::span<const float> pixels, int width, int height) {
  check_samples(pixels.size(), width, height, 3);
  Image8 image{width, height, std::vector<std::uint8_t>(pixels.size())};
  for (std::size_t i = 0; i < pixels.size(); ++i) image.rgb[i] = quantise(pixels[i], i);
  return image;
}

Image8 image_from_planar(std::span<const float> pixels, int width, int height) {
  check_samples(pixels.size(), width, height, 3);
  const std::size_t plane = pixels.size() / 3;
  Image8 image{width, height, std::vector<std::uint8_t>(pixels.size())};
  for (std::size_t c = 0; c < 3; ++c)
    for (std::size_t i = 0; i < plane; ++i)
      image.rgb[3 * i + c] = quantise(pixels[c * plane + i], c * plane + i);
  return image;
}

void save_png(const std::filesystem::path& path, const Image8& image) {
  check_samples(image.rgb.size(), image.width, image.height, 3);
  write_png(path, {image.width, image.height, 3, false, image.rgb});
}

void save_png_interleaved(const std::filesystem::path& path, std::span<const float> pixels, int width,
                          int height) {
  save_png(path, image_from_interleaved(pixels, width, height));
}

void save_png_planar(const std::filesystem::path& path, std::span<const float> pixels, int width,
                     int height) {
  save_png(path, image_from_planar(pixels, width, height));
}

void save_png_rgba(const std::filesystem::path& path, std::span<const std::uint8_t> rgba, int width,
                   int height) {
  check_samples(rgba.size(), width, height, 4);
  write_png(path, {width, height, 4, false, {rgba.begin(), rgba.end()}});
}

}  // namespace ubs
