// SPDX-License-Identifier: Apache-2.0
#include "host/scene/doubles.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <vector>

#include "host/base/parallel.hpp"
#include "host/scene/point_tree.hpp"
#include "host/scene/spatial_factor.hpp"
#include "kernels/dialect/dialect.h"
#include "kernels/limits.h"

namespace ubs {
namespace {

constexpr double kPosition = 0.03, kScale = 0.1, kColour = 0.05, kMean = 0.1, kBeta = 0.2;
constexpr double kConstantHarmonic = 0.28209479177387814;  // colour per unit of the constant harmonic
constexpr std::size_t kNearest = 9;                        // with the splat itself
constexpr std::size_t kMostCompared = 200'000;

// LiveSplats are the splats of a group that are not dead and whose position is finite.
struct LiveSplats {
  explicit LiveSplats(const SplatModel& model) : model(model), layout(model.layout()) {
    const double least = std::log(UBS_OPACITY_DEAD / (1 - UBS_OPACITY_DEAD));
    for (std::size_t i = 0; i < model.count; ++i) {
      const std::array<float, 3> at{model.row(0)[i], model.row(1)[i], model.row(2)[i]};
      const bool finite = std::ranges::all_of(at, [](float x) { return std::isfinite(x); });
      if (!finite || !(model.row(layout.opacity)[i] > least)) continue;
      ids.push_back(i);
      positions.push_back(at);
    }
  }
  double scale(int row, std::size_t i) const { return softplus_of(model.row(layout.scale + row)[i]); }
  double size(std::size_t i) const { return std::cbrt(scale(0, i) * scale(1, i) * scale(2, i)); }
  bool equal(std::size_t i, std::size_t j) const {
    const auto near = [&](int row, int rows, double least) {
      for (int r = row; r < row + rows; ++r)
        if (!(std::abs(model.row(r)[i] - model.row(r)[j]) < least)) return false;
      return true;
    };
    for (int c = 0; c < 3; ++c)
      if (!(std::abs(std::log(scale(c, i) / scale(c, j))) < kScale)) return false;
    // With direct conditioning, the scale of a query dimension is the inverse of its width.
    for (int q = 0; q < layout.query; ++q) {
      const double scale_q = scale(3 + q, i);
      if (!near(layout.mean + q, 1, kMean * (layout.variant.direct() ? 1 / scale_q : scale_q))) return false;
    }
    return near(layout.rgb, 3, layout.variant.harmonics() > 0 ? kColour / kConstantHarmonic : kColour) &&
           near(layout.beta, layout.mean - layout.beta, kBeta);
  }

  const SplatModel& model;
  ParameterLayout layout;
  std::vector<std::size_t> ids;
  std::vector<std::array<float, 3>> positions;
};

// Returns the number of splats, of every `step`-th one, that have a double.
std::size_t count_doubles(const LiveSplats& live, std::size_t step) {
  const TreePoints points{live.positions};
  const PointTree tree(3, points, nanoflann::KDTreeSingleIndexAdaptorParams(10));
  std::atomic<std::size_t> doubles = 0;
  const auto has_double = [&](std::size_t at) {
    const std::size_t i = live.ids[at];
    std::array<std::uint32_t, kNearest> found{};
    std::array<double, kNearest> squared{};
    const double query[3] = {live.positions[at][0], live.positions[at][1], live.positions[at][2]};
    const std::size_t count = tree.knnSearch(query, kNearest, found.data(), squared.data());
    const double reach = kPosition * live.size(i);
    for (std::size_t n = 0; n < count && squared[n] < reach * reach; ++n)
      if (found[n] != at && live.equal(i, live.ids[found[n]])) return true;
    return false;
  };
  const std::size_t block = 4096 * step;
  parallel_for((live.ids.size() + block - 1) / block, [&](std::size_t b) {
    const std::size_t end = std::min(live.ids.size(), (b + 1) * block);
    for (std::size_t at = b * block; at < end; at += step) doubles += has_double(at);
  });
  return doubles;
}

}  // namespace

double share_of_doubles(const MixedModel& model) {
  const std::size_t step = std::max<std::size_t>(1, (model.count() + kMostCompared - 1) / kMostCompared);
  std::size_t doubles = 0, compared = 0;
  for (const SplatModel& group : model.groups) {
    const LiveSplats live(group);
    if (live.ids.empty()) continue;
    doubles += count_doubles(live, step);
    compared += (live.ids.size() + step - 1) / step;
  }
  return compared > 0 ? static_cast<double>(doubles) / static_cast<double>(compared) : 0.0;
}

}  // namespace ubs
