// SPDX-License-Identifier: Apache-2.0
#include "host/scene/frustum_points.hpp"

#include <algorithm>

#include "host/base/error.hpp"
#include "host/base/philox.hpp"

namespace ubs {
namespace {

constexpr std::uint32_t kStream = 0x66727573;
constexpr std::uint8_t kGrey = 127;  // colour of points without a pixel and of random splats (method.md 1.3)

// Gives each point the colour of the pixel through which its ray was sampled.
void take_colours(PointCloud& cloud, std::span<const View> views, const CounterRandom& random) {
  for (std::size_t v = 0; v < std::min(views.size(), cloud.positions.size()); ++v) {
    if (!views[v].has_image()) continue;
    const Image8 image = views[v].load_image();
    for (std::size_t i = v; i < cloud.positions.size(); i += views.size()) {
      const auto pixel = [&](std::uint32_t draw, int size) {
        return std::min(size - 1, static_cast<int>(random.uniform(i, draw) * size));
      };
      const int at = pixel(2, image.height) * image.width + pixel(1, image.width);
      // The colour of a masked pixel is not valid, so the point stays grey.
      if (!image.mask.empty() && image.mask[static_cast<std::size_t>(at)] == 0) continue;
      std::copy_n(image.rgb.begin() + std::ptrdiff_t{3} * at, 3, cloud.colours[i].begin());
    }
  }
}

}  // namespace

PointCloud sample_frusta(std::span<const View> views, std::span<const std::array<double, 2>> bounds,
                         std::size_t count, std::uint64_t seed, PointColours colours) {
  if (views.empty() || views.size() != bounds.size())
    fail(ErrorKind::internal, "the number of views is {}, but {} of them have depth bounds", views.size(),
         bounds.size());
  const CounterRandom random(seed, kStream);
  PointCloud cloud;
  cloud.colours.assign(count, {kGrey, kGrey, kGrey});
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t v = i % views.size();
    const Camera& camera = views[v].camera;
    const double near = std::max(1e-6, bounds[v][0]), far = std::max(near, bounds[v][1]);
    const double depth = 1 / random.uniform(i, 0, 1 / far, 1 / near * (1 + 1e-12));
    const std::array<double, 3> centre = camera.centre(),
                                ray = camera.ray(random.uniform(i, 1) * camera.width,
                                                 random.uniform(i, 2) * camera.height);
    auto& point = cloud.positions.emplace_back();
    for (std::size_t k = 0; k < 3; ++k) point[k] = static_cast<float>(centre[k] + depth * ray[k]);
  }
  if (colours == PointColours::pixels) take_colours(cloud, views, random);
  return cloud;
}

}  // namespace ubs
