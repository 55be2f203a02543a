// SPDX-License-Identifier: Apache-2.0
#include "host/train/pyramid.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace ubs {
namespace {

int least_side(const Split& train) {
  int side = std::numeric_limits<int>::max();
  for (const View& view : train.views) side = std::min({side, view.camera.width, view.camera.height});
  return side;
}

// Square holds sums over the pixels of one square. `sum` is the sum over the pixels that are not masked,
// `all` is the sum over all pixels, and `counted` is the number of pixels that are not masked.
struct Square {
  unsigned sum[3] = {0, 0, 0}, all[3] = {0, 0, 0}, counted = 0;
};

Square sum_square(const Image8& image, int factor, int column, int row) {
  Square s;
  for (int y = row * factor; y < (row + 1) * factor; ++y)
    for (int x = column * factor; x < (column + 1) * factor; ++x) {
      const std::size_t pixel =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) + static_cast<std::size_t>(x);
      const bool counts = image.mask.empty() || image.mask[pixel] != 0;
      s.counted += counts;
      for (std::size_t c = 0; c < 3; ++c) {
        s.all[c] += image.rgb[3 * pixel + c];
        if (counts) s.sum[c] += image.rgb[3 * pixel + c];
      }
    }
  return s;
}

}  // namespace

std::vector<PyramidLevel> pyramid_levels(const TrainSettings& settings, const Split& train) {
  std::vector<PyramidLevel> levels;
  const int side = least_side(train);
  for (const PyramidStep& step : pyramid_steps(settings)) {
    int factor = step.factor;
    while (factor > 1 && side / factor < kMinShortSide) factor /= 2;
    if (factor == 1) continue;
    if (!levels.empty() && levels.back().factor <= factor)
      levels.back().until = step.share;
    else
      levels.push_back({factor, step.share});
  }
  levels.push_back({1, 1});
  return levels;
}

int factor_at(const std::vector<PyramidLevel>& levels, const WorkShare& work, int iteration) {
  for (const PyramidLevel& level : levels)
    if (iteration <= work.iteration_at(level.until * work.steps())) return level.factor;
  return 1;
}

int factor_at(const std::vector<PyramidLevel>& levels, double share) {
  for (const PyramidLevel& level : levels)
    if (share <= level.until) return level.factor;
  return 1;
}

Camera reduced(const Camera& camera, int factor) {
  Camera c = camera;
  c.width /= factor;
  c.height /= factor;
  for (double* value : {&c.fx, &c.fy, &c.cx, &c.cy}) *value /= factor;
  return c;
}

Image8 reduced(const Image8& image, int factor) {
  if (factor == 1) return image;
  Image8 out{image.width / factor, image.height / factor, {}, {}};
  const std::size_t pixels = static_cast<std::size_t>(out.width) * static_cast<std::size_t>(out.height);
  out.rgb.resize(3 * pixels);
  if (!image.mask.empty()) out.mask.resize(pixels);
  const auto square = static_cast<unsigned>(factor * factor);
  for (int row = 0; row < out.height; ++row)
    for (int column = 0; column < out.width; ++column) {
      const Square s = sum_square(image, factor, column, row);
      const std::size_t to = static_cast<std::size_t>(row) * static_cast<std::size_t>(out.width) +
                             static_cast<std::size_t>(column);
      const unsigned count = s.counted > 0 ? s.counted : square;
      for (std::size_t c = 0; c < 3; ++c)
        out.rgb[3 * to + c] =
            static_cast<std::uint8_t>(((s.counted > 0 ? s.sum[c] : s.all[c]) + count / 2) / count);
      if (!out.mask.empty()) out.mask[to] = 2 * s.counted >= square ? 255 : 0;
    }
  return out;
}

}  // namespace ubs
