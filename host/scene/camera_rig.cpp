// SPDX-License-Identifier: Apache-2.0
// See camera_rig.hpp.
#include "host/scene/camera_rig.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "host/scene/extent.hpp"
#include "host/scene/pose.hpp"

namespace ubs {
namespace {

// Smallest determinant (see nearest_to_axes) for which the view axes of the cameras count as meeting in one
// point. The scene fern of LLFF, which was photographed from one side, has a determinant of 0.011, and its
// axes meet at 1.1 times the median depth of its points. The determinant is 0.26 to 0.29 for photographs
// taken around an object or in a room (lego of NeRF Synthetic, bonsai of Mip-NeRF 360, cup of COLMAP).
constexpr double kJustConverging = 0.002;
// Half the side of the cube that all cameras see, relative to half the size of the image (the geometric mean
// of width and height) at the depth of the meeting point. With this value, half the side is 1.31 for NeRF
// Synthetic; the published box has 1.3.
constexpr double kFilled = 0.9;
// Smallest and largest depth, relative to the depth of the meeting point. For comparison, the central 96 % of
// the points have relative depths of 0.5 to 1.6 in cup, 0.8 to 4.0 in bonsai and 0.6 to 2.1 in fern.
constexpr double kNearer = 0.5, kFarther = 4;
// Without a meeting point, the only known length is the spread of the cameras (spread_of), so the range of
// depths is given in multiples of the spread. The multiples are larger for parallel cameras, which are close
// together compared with the distance of the scene (the cameras of fern are nearly parallel: its depths are
// 3.8 to 13 times the spread). Cameras that are not parallel move through the scene, so parts of the scene
// can be closer than the spread. Cameras count as parallel if the mean of their unit view directions is
// longer than kParallel.
constexpr double kParallel = 0.95;
constexpr double kParallelNear = 2, kParallelFar = 20, kWalkNear = 0.5, kWalkFar = 10;
// Minimum depth of the meeting point, relative to the spread of the cameras. A smaller depth means that the
// point is among the cameras themselves.
constexpr double kMinDepth = 1e-3;

Vec3 mean_of(std::span<const Camera> cameras, Vec3 (*value)(const Camera&)) {
  Vec3 mean{};
  for (const Camera& c : cameras) mean = mean + 1.0 / static_cast<double>(cameras.size()) * value(c);
  return mean;
}

// Returns the largest distance of a camera from the mean position of all cameras.
double spread_of(std::span<const Camera> cameras) {
  const Vec3 mean = mean_of(cameras, [](const Camera& c) -> Vec3 { return c.centre(); });
  double most = 0;
  for (const Camera& c : cameras) most = std::max(most, length(c.centre() - mean));
  return most;
}

InitialSpace between(double near, double far, std::string why) {
  return {
      .near = near,
      .far = far,
      .depth = std::sqrt(near * far),
      .text = fmt::format("where the cameras see depths from {:.3g} to {:.3g}, because {}", near, far, why)};
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
    return between(1, 10, "all cameras have the same position, so the scale of the scene is arbitrary");
  const std::optional<Vec3> meeting = meeting_point(cameras, kJustConverging);
  const auto depth_of = [](const Vec3& point, const Camera& c) {
    return dot(point - c.centre(), camera_axis(c, 2));
  };
  const double depth = meeting ? median(cameras, [&](const Camera& c) { return depth_of(*meeting, c); }) : 0;
  if (!(depth > kMinDepth * spread)) {
    const Vec3 forward = mean_of(cameras, view_direction);
    return length(forward) > kParallel
               ? between(kParallelNear * spread, kParallelFar * spread,
                         "the cameras look in the same direction")
               : between(kWalkNear * spread, kWalkFar * spread, "the cameras look outwards");
  }
  if (!nothing_behind || !meeting_point(cameras)) {
    InitialSpace space = between(kNearer * depth, kFarther * depth,
                                 fmt::format("the axes of the cameras meet at {:.3g}", depth));
    space.depth = depth;
    return space;
  }
  const double half = kFilled * median(cameras, [&](const Camera& c) {
                        return 0.5 * depth_of(*meeting, c) * std::sqrt(c.width / c.fx * (c.height / c.fy));
                      });
  const auto shown = [&](std::size_t k) {  // values that are only rounding errors are printed as 0
    return std::abs((*meeting)[k]) < 1e-6 * depth ? 0.0 : (*meeting)[k];
  };
  return {
      .centre = *meeting,
      .half = half,
      .depth = depth,
      .text = fmt::format("in the cube that all cameras see, with the centre ({:.3g}, {:.3g}, {:.3g}) and "
                          "sides of {:.3g}",
                          shown(0), shown(1), shown(2), 2 * half)};
}

}  // namespace ubs
