// SPDX-License-Identifier: Apache-2.0
#include "host/scene/extent.hpp"

#include <algorithm>
#include <cmath>

#include "host/base/error.hpp"

namespace ubs {

double scene_extent(std::span<const View> views) {
  if (views.empty()) fail(ErrorKind::data, "scene extent: the training split has no views");
  std::array<double, 3> mean{};
  for (const View& view : views) {
    const auto c = view.camera.centre();
    for (int axis = 0; axis < 3; ++axis) mean[axis] += c[axis] / static_cast<double>(views.size());
  }
  double largest = 0;
  for (const View& view : views) {
    const auto c = view.camera.centre();
    largest = std::max(largest, std::hypot(c[0] - mean[0], c[1] - mean[1], c[2] - mean[2]));
  }
  return 1.1 * largest;
}

double position_spread(std::span<const Camera> cameras) {
  double spread = 0;
  for (const Camera& camera : cameras) {
    const auto c = camera.centre(), first = cameras.front().centre();
    spread = std::max(spread, std::hypot(c[0] - first[0], c[1] - first[1], c[2] - first[2]));
  }
  return spread;
}

bool at_one_place(std::span<const Camera> cameras) {
  constexpr double kRounding = 1e-7;  // relative to the distance from the origin
  double distance = 0;
  for (const Camera& camera : cameras) {
    const auto c = camera.centre();
    distance = std::max(distance, std::hypot(c[0], c[1], c[2]));
  }
  return position_spread(cameras) <= kRounding * distance;
}

}  // namespace ubs
