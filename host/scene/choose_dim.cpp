// SPDX-License-Identifier: Apache-2.0
#include "host/scene/choose_dim.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <set>

#include "host/base/error.hpp"
#include "host/scene/extent.hpp"
#include "host/scene/pose.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs {
namespace {

constexpr double kSameDegrees = 0.5;  // smaller changes of the view direction have no visible effect
constexpr double kSameTime = 1e-9;
// Minimum determinant for nearest_to_axes(). Optical axes within about 0.1 degrees count as parallel.
constexpr double kParallelAxes = 1e-6;

// Returns the largest angle between the directions from any two cameras to the point that is nearest to all
// optical axes, in degrees. Returns 0 if all cameras have the same position, and 180 if their optical axes
// are parallel.
double direction_spread(std::span<const View> views) {
  std::vector<Camera> cameras;
  for (const View& view : views) cameras.push_back(view.camera);
  const std::optional<Vec3> target = nearest_to_axes(cameras, kParallelAxes);
  std::vector<Vec3> directions;
  for (const Camera& camera : cameras) {
    if (target) directions.push_back(normalised(*target - camera.centre()));
  }
  if (at_one_place(cameras)) return 0;
  if (!target) return 180;  // the optical axes are parallel, so the distance of the scene is unknown
  double least = 1;
  for (std::size_t i = 0; i < directions.size(); ++i)
    for (std::size_t k = 0; k < i; ++k) least = std::min(least, dot(directions[i], directions[k]));
  return std::acos(std::clamp(least, -1.0, 1.0)) * 180 / std::numbers::pi;
}

// Returns query value k of a camera, not counting the direction. k = 0 is the time.
double query_value(const Camera& camera, std::size_t k) { return k == 0 ? camera.time : camera.extra[k - 1]; }

// Returns the number of query values, counted up to the last one that differs between views.
std::size_t values_that_differ(std::span<const View> views) {
  std::size_t available = kMaxDim - 6;
  for (const View& view : views) available = std::min(available, view.camera.extra.size() + 1);
  std::size_t needed = 0;
  for (std::size_t k = 0; k < available; ++k) {
    const auto [low, high] =
        std::ranges::minmax_element(views, {}, [&](const View& v) { return query_value(v.camera, k); });
    if (query_value(high->camera, k) - query_value(low->camera, k) > kSameTime) needed = k + 1;
  }
  return needed;
}

}  // namespace

DimChoice choose_dim(std::span<const View> train) {
  if (train.empty())
    fail(ErrorKind::data, "--dim auto requires training views, but the training split has none");
  const std::size_t values = values_that_differ(train);
  const double spread = direction_spread(train);
  bool direction = spread > kSameDegrees;
  std::set<double> times;
  for (const View& view : train) times.insert(view.camera.time);

  std::string why =
      times.size() > 1 ? fmt::format("{} different times", times.size()) : "all times are equal";
  if (values > 1) why += fmt::format(", {} further query values", values - 1);
  if (train.size() == 1)
    why += ", a single view";
  else if (direction)
    why += spread < 180 ? fmt::format(", seen from directions up to {:.0f} degrees apart", spread)
                        : ", seen from different positions";
  else
    why += fmt::format(", seen from one direction (within {:.1g} degrees)", kSameDegrees);
  // N = 6 always stands for a position and a direction (kernels/layout.h). A model with three or more query
  // values therefore always includes the direction.
  if (!direction && values > 2) {
    direction = true;
    why += "; the direction is included, because two or more further query values require it";
  }
  return {3 + (direction ? 3 : 0) + static_cast<int>(values), why};
}

}  // namespace ubs
