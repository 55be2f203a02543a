// SPDX-License-Identifier: Apache-2.0
// This file creates small images for loader tests. They are smooth enough to survive resampling, and
// different everywhere.
#pragma once

#include <cmath>

#include "host/data/image.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs::test {

inline Image8 gradient_image(int width, int height, int shift = 0) {
  Image8 image{width, height, {}};
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (const double v : {127 + 100 * std::sin((x + shift) * 0.05), 127 + 100 * std::cos(y * 0.06),
                             127 + 60 * std::sin((x + y) * 0.04)})
        image.rgb.push_back(static_cast<std::uint8_t>(v));
  return image;
}

inline void put_image(const std::filesystem::path& path, int width, int height, int shift = 0) {
  std::filesystem::create_directories(path.parent_path());
  save_png(path, gradient_image(width, height, shift));
}

// Returns the mean absolute difference per sample, or -1 if the sizes differ.
inline double image_difference(const Image8& a, const Image8& b) {
  if (a.width != b.width || a.height != b.height) return -1;
  double sum = 0;
  for (std::size_t i = 0; i < a.rgb.size(); ++i) sum += std::abs(int{a.rgb[i]} - int{b.rgb[i]});
  return sum / static_cast<double>(a.rgb.size());
}

}  // namespace ubs::test
