// SPDX-License-Identifier: Apache-2.0
// resize_bicubic() changes the width first and then the height, with an 8-bit intermediate image. The
// weights are those of the Keys kernel (a = -1/2), stretched by the reduction factor, normalised, and rounded
// to 22 fractional bits. The sums are integers, so the result is exact on every machine. The method is
// documented in Pillow's handbook ("Filters"), and the result was compared byte by byte with Pillow 13.0
// (tests/data/image_test.cpp).
#include "host/dataset/resample.hpp"

#include <algorithm>
#include <cmath>

#include "host/base/error.hpp"

namespace ubs {

namespace {

// Number of fractional bits of a weight. Of the other 10 bits of a sum, 8 are for the value and 2 for
// overshoot.
constexpr int kWeightBits = 22;

double keys_kernel(double x) {
  constexpr double a = -0.5;
  x = std::abs(x);
  if (x < 1) return ((a + 2) * x - (a + 3)) * x * x + 1;
  if (x < 2) return (((x - 5) * x + 8) * x - 4) * a;
  return 0;
}

struct Taps {
  int first = 0;
  std::vector<int> weights;  // in fixed point
};

std::vector<Taps> make_taps(int in, int out) {
  const double scale = static_cast<double>(in) / out, stretch = std::max(scale, 1.0);
  const double support = 2.0 * stretch;
  std::vector<Taps> taps(static_cast<std::size_t>(out));
  for (int o = 0; o < out; ++o) {
    const double centre = (o + 0.5) * scale;
    const int first = std::max(0, static_cast<int>(centre - support + 0.5));
    const int last = std::min(in, static_cast<int>(centre + support + 0.5));
    std::vector<double> weights;
    double sum = 0;
    for (int i = first; i < last; ++i) {
      weights.push_back(keys_kernel((i - centre + 0.5) * (1.0 / stretch)));
      sum += weights.back();
    }
    taps[static_cast<std::size_t>(o)].first = first;
    for (const double w : weights)
      taps[static_cast<std::size_t>(o)].weights.push_back(
          static_cast<int>(std::floor(w / sum * (1 << kWeightBits) + 0.5)));
  }
  return taps;
}

std::uint8_t filter(const std::uint8_t* source, std::ptrdiff_t step, const Taps& taps) {
  int sum = 1 << (kWeightBits - 1);
  for (const int weight : taps.weights) {
    sum += weight * *source;
    source += step;
  }
  return static_cast<std::uint8_t>(std::clamp(sum >> kWeightBits, 0, 255));
}

}  // namespace

Image8 resize_bicubic(const Image8& image, int width, int height) {
  if (width < 1 || height < 1 || image.width < 1 || image.height < 1)
    fail(ErrorKind::internal, "cannot resize an image from {}x{} to {}x{} pixels", image.width, image.height,
         width, height);
  const auto at = [](int w, int x, int y) { return 3 * (static_cast<std::ptrdiff_t>(y) * w + x); };

  Image8 narrow{width, image.height, {}};
  narrow.rgb.resize(static_cast<std::size_t>(at(width, 0, image.height)));
  const std::vector<Taps> columns = make_taps(image.width, width), rows = make_taps(image.height, height);
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < 3; ++c) {
        const Taps& taps = columns[static_cast<std::size_t>(x)];
        narrow.rgb[static_cast<std::size_t>(at(width, x, y) + c)] =
            filter(image.rgb.data() + at(image.width, taps.first, y) + c, 3, taps);
      }

  Image8 result{width, height, {}};
  result.rgb.resize(static_cast<std::size_t>(at(width, 0, height)));
  for (int y = 0; y < height; ++y)
    for (int i = 0; i < 3 * width; ++i) {
      const Taps& taps = rows[static_cast<std::size_t>(y)];
      result.rgb[static_cast<std::size_t>(at(width, 0, y) + i)] = filter(
          narrow.rgb.data() + at(width, 0, taps.first) + i, 3 * static_cast<std::ptrdiff_t>(width), taps);
    }
  return result;
}

}  // namespace ubs
