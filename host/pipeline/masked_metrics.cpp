// SPDX-License-Identifier: Apache-2.0
#include "host/pipeline/masked_metrics.hpp"

#include <array>
#include <cmath>

namespace ubs {
namespace {

constexpr std::size_t kTaps = 11;

std::array<double, kTaps> window() {
  std::array<double, kTaps> weights{};
  double sum = 0;
  for (std::size_t k = 0; k < kTaps; ++k) {
    const double d = static_cast<double>(k) - 5;
    sum += weights[k] = std::exp(-d * d / 4.5);
  }
  for (double& w : weights) w /= sum;
  return weights;
}

// Sums contains the weighted sums over a window of the five quantities that SSIM needs, in this order: a, b,
// a a, b b, a b.
using Sums = std::array<double, 5>;

Sums add(Sums sums, double weight, const Sums& values) {
  for (std::size_t q = 0; q < sums.size(); ++q) sums[q] += weight * values[q];
  return sums;
}

double ssim_of(const Sums& s) {
  const double covariance = s[4] - s[0] * s[1], variances = s[2] - s[0] * s[0] + s[3] - s[1] * s[1];
  return (2 * s[0] * s[1] + 1e-4) * (2 * covariance + 9e-4) /
         ((s[0] * s[0] + s[1] * s[1] + 1e-4) * (variances + 9e-4));
}

// Returns for each window, indexed by its first pixel, whether it contains no masked pixel.
std::vector<bool> whole_windows(std::span<const std::uint8_t> mask, std::size_t width, std::size_t height) {
  // `masked` contains, for each corner of a pixel, the number of masked pixels above and to the left of it.
  std::vector<std::size_t> masked((width + 1) * (height + 1));
  for (std::size_t y = 0; y < height; ++y)
    for (std::size_t x = 0; x < width; ++x)
      masked[(y + 1) * (width + 1) + x + 1] = masked[y * (width + 1) + x + 1] +
                                              masked[(y + 1) * (width + 1) + x] -
                                              masked[y * (width + 1) + x] + (mask[y * width + x] == 0);
  std::vector<bool> whole(width * height);
  for (std::size_t y = 0; y + kTaps <= height; ++y)
    for (std::size_t x = 0; x + kTaps <= width; ++x) {
      const std::size_t top = y * (width + 1) + x, bottom = (y + kTaps) * (width + 1) + x;
      whole[y * width + x] = masked[bottom + kTaps] + masked[top] == masked[bottom] + masked[top + kTaps];
    }
  return whole;
}

}  // namespace

std::optional<double> masked_valid_ssim(std::span<const float> a, std::span<const float> b,
                                        std::span<const std::uint8_t> mask, PlanarSize size) {
  const std::size_t width = static_cast<std::size_t>(size.width),
                    height = static_cast<std::size_t>(size.height);
  if (width < kTaps || height < kTaps) return std::nullopt;
  const std::vector<bool> whole = whole_windows(mask, width, height);
  const std::array<double, kTaps> weights = window();
  std::vector<Sums> rows(width * height);
  double sum = 0;
  std::size_t windows = 0;
  for (std::size_t channel = 0; channel < 3; ++channel) {
    const float *pa = a.data() + channel * width * height, *pb = b.data() + channel * width * height;
    for (std::size_t y = 0; y < height; ++y)
      for (std::size_t x = 0; x + kTaps <= width; ++x) {
        Sums row{};
        for (std::size_t k = 0; k < kTaps; ++k) {
          const double va = pa[y * width + x + k], vb = pb[y * width + x + k];
          row = add(row, weights[k], {va, vb, va * va, vb * vb, va * vb});
        }
        rows[y * width + x] = row;
      }
    for (std::size_t i = 0; i < whole.size(); ++i) {
      if (!whole[i]) continue;
      Sums all{};
      for (std::size_t k = 0; k < kTaps; ++k) all = add(all, weights[k], rows[i + k * width]);
      sum += ssim_of(all);
      ++windows;
    }
  }
  if (windows == 0) return std::nullopt;
  return sum / static_cast<double>(windows);
}

std::vector<float> fill_masked(std::span<const float> image, std::span<const float> other,
                               std::span<const std::uint8_t> mask) {
  std::vector<float> filled(image.begin(), image.end());
  for (std::size_t i = 0; i < filled.size(); ++i)
    if (mask[i % mask.size()] == 0) filled[i] = other[i];
  return filled;
}

}  // namespace ubs
