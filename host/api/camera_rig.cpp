// SPDX-License-Identifier: Apache-2.0
// See camera_rig.hpp.
#include "host/api/camera_rig.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "host/scene/extent.hpp"
#include "host/scene/pose.hpp"

namespace ubs {
namespace {

// Smallest determinant (see nearest_to_axes) for which the cameras have a common point. LLFF's fern,
// photographed from one side, has 0.011, and its axes meet at 1.1 times the median depth of its points.
// Captures around an object or in a room (NeRF Synthetic's lego, Mip-NeRF 360's bonsai, COLMAP's cup) have
// 0.26 to 0.29.
constexpr double kJustConverging = 0.002;
// Half size of the common space, relative to half the width of the image at the meeting point. With this
// value NeRF Synthetic gets 1.31; its published box has a half size of 1.3.
constexpr double kFilled = 0.9;
// Range of depths relative to the depth of the meeting point. For comparison, 96 % of the points are at: cup
// 0.5 to 1.6, bonsai 0.8 to 4.0, fern 0.6 to 2.1.
constexpr double kNearer = 0.5, kFarther = 4;
// Without a meeting point, the only known length is the spread of the cameras, so the range of depths is a
// multiple of it. It is a larger multiple for parallel cameras, which are close together compared with the
// scene (fern: depths of 3.8 to 13). Other cameras move through the scene, which can also be closer than
// their spread.
constexpr double kParallel = 0.95;
constexpr double kParallelNear = 2, kParallelFar = 20, kWalkNear = 0.5, kWalkFar = 10;
// Minimum depth of the meeting point, relative to the spread of the cameras. A smaller depth means that the
// point is where the cameras are.
constexpr double kMinDepth = 1e-3;

Vec3 mean_of(std::span<const Camera> cameras, Vec3 (*value)(const Camera&)) {
  Vec3 mean{};
  for (const Camera& c : cameras) mean = mean + 1.0 / static_cast<double>(cameras.size()) * value(c);
  return mean;
}

double spread_of(std::span<const Camera> cameras) {
  const Vec3 mean = mean_of(cameras, [](const Camera& c) -> Vec3 { return c.centre(); });
  double most = 0;
  for (const Camera& c : cameras) most = std::max(most, length(c.centre() - mean));
  return most;
}

InitialSpace between(double near, double far, std::string why) {
  return {.near = near,
          .far = far,
          .depth = std::sqrt(near * far),
          .text = fmt::format("where the cameras see depths from {:.3g} to {:.3g}: {}", near, far, why)};
}

}  // namespace

std::optional<Vec3> meeting_point(std::span<const Camera> cameras, double least) {
  const std::optional<Vec3> point = nearest_to_axes(cameras, least);
  if (!point) return std::nullopt;
  const auto ahead = std::ranges::count_if(
      cameras, [&](const Camera& c) { return dot(*point - c.centre(), view_direction(c)) > 0; });
  if (2 * static_cast<std::size_t>(ahead) <= cameras.size()) return std::nullopt;
  return point;
}

InitialSpace initial_space(std::span<const Camera> cameras, bool nothing_behind) {
  const double spread = spread_of(cameras);
  // With one camera, or cameras that only rotate, the images do not depend on the size of the scene.
  if (at_one_place(cameras))
    return between(1, 10, "all cameras have the same position, so any depth will do");
  const std::optional<Vec3> meeting = meeting_point(cameras, kJustConverging);
  const auto depth_of = [](const Vec3& point, const Camera& c) {
    return dot(point - c.centre(), camera_axis(c, 2));
  };
  const double depth = meeting ? median(cameras, [&](const Camera& c) { return depth_of(*meeting, c); }) : 0;
  if (!(depth > kMinDepth * spread)) {
    const Vec3 forward = mean_of(cameras, view_direction);
    return length(forward) > kParallel
               ? between(kParallelNear * spread, kParallelFar * spread, "they look the same way")
               : between(kWalkNear * spread, kWalkFar * spread, "they look outwards");
  }
  if (!nothing_behind || !meeting_point(cameras)) {
    InitialSpace space =
        between(kNearer * depth, kFarther * depth, fmt::format("their axes meet at {:.3g}", depth));
    space.depth = depth;
    return space;
  }
  const double half = kFilled * median(cameras, [&](const Camera& c) {
                        return 0.5 * depth_of(*meeting, c) * std::sqrt(c.width / c.fx * (c.height / c.fy));
                      });
  const auto shown = [&](std::size_t k) {  // shows values that are only rounding errors as 0
    return std::abs((*meeting)[k]) < 1e-6 * depth ? 0.0 : (*meeting)[k];
  };
  return {
      .centre = *meeting,
      .half = half,
      .depth = depth,
      .text = fmt::format("in the space that the cameras see in common, within {:.3g} of ({:.3g}, {:.3g}, "
                          "{:.3g}) along each axis",
                          half, shown(0), shown(1), shown(2))};
}

}  // namespace ubs
