// SPDX-License-Identifier: Apache-2.0
// See grey_png.hpp.
#include "host/dataset/grey_png.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "host/base/error.hpp"
#include "host/dataset/png.hpp"

namespace ubs {
namespace {

void check(std::span<const float> pixels, int width, int height, const std::filesystem::path& path) {
  if (width < 1 || height < 1 ||
      pixels.size() != static_cast<std::size_t>(width) * static_cast<std::size_t>(height))
    fail(ErrorKind::internal, "{}: an image of {}x{} pixels cannot be made of {} samples", path.string(),
         width, height, pixels.size());
  const auto bad = std::ranges::find_if(pixels, [](float v) { return !std::isfinite(v); });
  if (bad != pixels.end())
    fail(ErrorKind::numerical, "{}: the image is not written, because pixel {} is {}", path.string(),
         bad - pixels.begin(), *bad);
}

// Writes the samples round(scale * (value - low)), clamped to the range of the type.
template <typename Sample>
void save(const std::filesystem::path& path, std::span<const float> pixels, int width, int height, float low,
          float scale) {
  constexpr float kMax = std::numeric_limits<Sample>::max();
  std::vector<Sample> samples(pixels.size());
  for (std::size_t i = 0; i < pixels.size(); ++i)
    samples[i] = static_cast<Sample>(std::clamp((pixels[i] - low) * scale, 0.0f, kMax) + 0.5f);
  write_png(path, {width, height, 1, sizeof(Sample)}, samples.data());
}

}  // namespace

void save_png_grey8(const std::filesystem::path& path, std::span<const float> pixels, int width, int height) {
  check(pixels, width, height, path);
  save<std::uint8_t>(path, pixels, width, height, 0.0f, 255.0f);
}

GreyRange save_png_grey16(const std::filesystem::path& path, std::span<const float> pixels, int width,
                          int height) {
  check(pixels, width, height, path);
  const auto [low, high] = std::ranges::minmax(pixels);
  save<std::uint16_t>(path, pixels, width, height, low, high > low ? 65535.0f / (high - low) : 0.0f);
  return {low, high};
}

}  // namespace ubs
