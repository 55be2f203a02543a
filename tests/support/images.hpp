// SPDX-License-Identifier: Apache-2.0
// Defines functions that create and compare small images for tests of loaders. The images are so smooth that
// resampling hardly changes them, and no two regions are equal.
#pragma once

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

#include "host/base/json.hpp"
#include "host/dataset/image.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs::test {

// Returns an image whose channels are waves in different directions. `shift` moves the pattern of the first
// channel by this number of pixels.
inline Image8 gradient_image(int width, int height, int shift = 0) {
  Image8 image{width, height, {}};
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (const double v : {127 + 100 * std::sin((x + shift) * 0.05), 127 + 100 * std::cos(y * 0.06),
                             127 + 60 * std::sin((x + y) * 0.04)})
        image.rgb.push_back(static_cast<std::uint8_t>(v));
  return image;
}

inline Image8 plain_image(int width, int height, int red, int green, int blue) {
  Image8 image{width, height, {}};
  for (int i = 0; i < width * height; ++i)
    for (const int v : {red, green, blue}) image.rgb.push_back(static_cast<std::uint8_t>(v));
  return image;
}

inline void put_image(const std::filesystem::path& path, int width, int height, int shift = 0) {
  std::filesystem::create_directories(path.parent_path());
  save_png(path, gradient_image(width, height, shift));
}

// Writes a data set (transforms.json and PNG files) of panoramas of 128x64 pixels, whose positions are 0.1
// apart.
inline void put_panoramas(const std::filesystem::path& folder, int count) {
  Json data{{"camera_model", "EQUIRECTANGULAR"}, {"w", 128}, {"h", 64}, {"frames", Json::array()}};
  for (int i = 0; i < count; ++i) {
    const std::string name = std::to_string(i) + ".png";
    put_image(folder / name, 128, 64, 40 * i);
    data["frames"].push_back(
        {{"file_path", name},
         {"transform_matrix", {{1, 0, 0, 0.1 * i}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}}}});
  }
  put(folder / "transforms.json", data.dump());
}

// Returns the mean absolute difference per sample, or -1 if the sizes differ.
inline double image_difference(const Image8& a, const Image8& b) {
  if (a.width != b.width || a.height != b.height) return -1;
  double sum = 0;
  for (std::size_t i = 0; i < a.rgb.size(); ++i) sum += std::abs(int{a.rgb[i]} - int{b.rgb[i]});
  return sum / static_cast<double>(a.rgb.size());
}

}  // namespace ubs::test
