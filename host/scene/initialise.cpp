// SPDX-License-Identifier: Apache-2.0
#include "host/scene/initialise.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "host/base/error.hpp"
#include "host/base/parallel.hpp"
#include "host/base/philox.hpp"
#include "host/scene/point_tree.hpp"
#include "host/scene/spatial_factor.hpp"

namespace ubs {

namespace {

// Each parameter group has its own random stream, so that a new group does not change the random numbers of
// the other groups.
enum InitialStream : std::uint32_t { kPositions, kMeans, kQueryScales, kTriangle, kLobes };

constexpr std::size_t kNeighbours = 3;
constexpr double kMinScale = 1e-7;
// Neighbour distance of a single point, which has no neighbours. A splat of this size is visible in a scene
// of unit size.
constexpr double kLonePointScale = 0.1;
constexpr double kJitter = 1e-5;  // standard deviation of the noise that breaks the symmetry of equal entries

// Returns the root of the mean squared distance to the nearest neighbours. The point itself is excluded by
// its index, not by its distance, because duplicates are real neighbours.
double neighbour_distance(const PointTree& tree, Positions positions, std::size_t i) {
  std::array<std::uint32_t, kNeighbours + 1> found{};
  std::array<double, kNeighbours + 1> squared{};
  const double query[3] = {positions[i][0], positions[i][1], positions[i][2]};
  const std::size_t n = tree.knnSearch(query, found.size(), found.data(), squared.data());
  double sum = 0;
  std::size_t used = 0;
  for (std::size_t k = 0; k < n && used < kNeighbours; ++k) {
    if (found[k] == i) continue;
    sum += squared[k];
    ++used;
  }
  return std::max(kMinScale, std::sqrt(sum / static_cast<double>(used)));
}

void check_points(Positions positions, std::size_t colours) {
  if (positions.empty()) fail(ErrorKind::data, "initialisation needs at least one point");
  if (positions.size() != colours)
    fail(ErrorKind::internal, "{} points need as many colours, but there are {}", positions.size(), colours);
  for (std::size_t i = 0; i < positions.size(); ++i)
    for (const float coordinate : positions[i])
      if (!std::isfinite(coordinate)) fail(ErrorKind::data, "initial point {} is not finite", i);
}

// Sets the means of the query dimensions to uniform random numbers, in (-1, 1) for the direction and in (0,
// 1) for the other query dimensions.
void draw_means(SplatModel& model, std::uint64_t seed) {
  const ParameterLayout layout = model.layout();
  const CounterRandom random(seed, kMeans);
  const int directions = layout.query >= 3 ? 3 : 0;
  for (int q = 0; q < layout.query; ++q) {
    auto row = model.row(layout.mean + q);
    const double low = q < directions ? -1.0 : 0.0;
    for (std::size_t i = 0; i < model.count; ++i)
      row[i] = static_cast<float>(random.uniform(i, static_cast<std::uint32_t>(q), low, 1.0));
  }
}

// Sets the axes of the lobes to random directions, distributed uniformly on the sphere. The raw colours and
// betas of the lobes remain 0.
void draw_lobes(SplatModel& model, std::uint64_t seed) {
  const int lobes = model.variant.lobes(), first = model.layout().rgb + 3;
  const CounterRandom random(seed, kLobes);
  for (int lobe = 0; lobe < lobes; ++lobe) {
    const auto draw = static_cast<std::uint32_t>(2 * lobe);
    for (std::size_t i = 0; i < model.count; ++i) {
      model.row(first + 3 * lobes + lobe)[i] =
          static_cast<float>(std::acos(random.uniform(i, draw, -1.0, 1.0)));
      model.row(first + 4 * lobes + lobe)[i] =
          static_cast<float>(random.uniform(i, draw + 1, -std::numbers::pi, std::numbers::pi));
    }
  }
}

void draw_covariance(SplatModel& model, Positions positions, std::uint64_t seed, double ratio) {
  const ParameterLayout layout = model.layout();
  const std::vector<double> distances = neighbour_distances(positions);
  for (int axis = 0; axis < 3; ++axis)
    for (std::size_t i = 0; i < model.count; ++i)
      model.row(layout.scale + axis)[i] = static_cast<float>(inverse_softplus_of(distances[i] / ratio));
  const CounterRandom scales(seed, kQueryScales), triangle(seed, kTriangle);
  for (int q = 0; q < layout.query; ++q)
    for (std::size_t i = 0; i < model.count; ++i)
      model.row(layout.scale + 3 + q)[i] = static_cast<float>(
          inverse_softplus_of(1.0 + kJitter * scales.normal(i, static_cast<std::uint32_t>(q))));
  for (int entry = 0; entry < layout.count - layout.l_triangle; ++entry) {
    // The first entry of a quaternion is w = 1. All other entries, in every parametrisation, start near 0.
    const double start = model.variant.rot_mode == RotMode::quaternion && entry == 0 ? 1 : 0;
    for (std::size_t i = 0; i < model.count; ++i)
      model.row(layout.l_triangle + entry)[i] =
          static_cast<float>(start + kJitter * triangle.normal(i, static_cast<std::uint32_t>(entry)));
  }
}

// Returns the raw colour parameter for a value in [0, 1]: the value itself, or the coefficient of the
// constant harmonic that gives it.
double raw_colour(double value, const ModelVariant& variant) {
  constexpr double kConstantHarmonic = 0.28209479177387814;  // 1 / (2 sqrt(pi))
  return variant.harmonics() ? (value - 0.5) / kConstantHarmonic : value;
}

void fill_betas(SplatModel& model, const InitOptions& options) {
  const ParameterLayout layout = model.layout();
  if (!model.variant.has_query_beta()) return;
  // With learnt weights, the parameters are not exponents of the opacity, and low values would not make
  // splats visible from more directions. Their raw values are 0, which is a weight of 1/2.
  const double beta_dir =
      options.beta_dir.value_or(model.dim == 7 && !model.variant.learnt_weights() ? -3.0 : 0.0);
  const int directions = layout.query >= 3 ? 3 : 0;
  for (int q = 0; q < layout.query; ++q)
    std::ranges::fill(model.row(layout.query_beta + q),
                      static_cast<float>(q < directions ? beta_dir : options.beta_query));
}

}  // namespace

std::vector<double> neighbour_distances(Positions positions) {
  if (positions.size() == 1) return {kLonePointScale};
  const TreePoints points{positions};
  const PointTree tree(3, points, nanoflann::KDTreeSingleIndexAdaptorParams(10));
  std::vector<double> distances(positions.size());
  constexpr std::size_t kBlock = 4096;
  parallel_for((positions.size() + kBlock - 1) / kBlock, [&](std::size_t block) {
    const std::size_t end = std::min(positions.size(), (block + 1) * kBlock);
    for (std::size_t i = block * kBlock; i < end; ++i) distances[i] = neighbour_distance(tree, positions, i);
  });
  return distances;
}

SplatModel initialise_from_points(int dim, Positions positions,
                                  std::span<const std::array<std::uint8_t, 3>> colours, std::uint64_t seed,
                                  const InitOptions& options) {
  check_points(positions, colours.size());
  if (!(options.opacity > 0 && options.opacity < 1))
    fail(ErrorKind::usage, "initial opacity {} must lie between 0 and 1", options.opacity);
  SplatModel model(dim, positions.size(), options.variant);
  const ParameterLayout layout = model.layout();
  for (int axis = 0; axis < 3; ++axis)
    for (std::size_t i = 0; i < model.count; ++i) {
      model.row(layout.xyz + axis)[i] = positions[i][static_cast<std::size_t>(axis)];
      model.row(layout.rgb + axis)[i] =
          static_cast<float>(raw_colour(colours[i][static_cast<std::size_t>(axis)] / 255.0, model.variant));
    }
  const double logit = std::log(options.opacity / (1.0 - options.opacity));
  std::ranges::fill(model.row(layout.opacity), static_cast<float>(logit));
  fill_betas(model, options);
  draw_means(model, seed);
  draw_lobes(model, seed);
  draw_covariance(model, positions, seed,
                  options.initial_ratio.value_or(row_of(model.variant.kernel).initial_ratio));
  return model;
}

SplatModel initialise_random(int dim, std::size_t points, std::uint64_t seed, const InitOptions& options) {
  if (!(options.box > 0) || !std::isfinite(options.box))
    fail(ErrorKind::usage, "half size {} of the initial box must be positive", options.box);
  const CounterRandom random(seed, kPositions);
  std::vector<std::array<float, 3>> positions(points);
  for (std::size_t i = 0; i < points; ++i)
    for (std::uint32_t axis = 0; axis < 3; ++axis)
      positions[i][axis] =
          static_cast<float>(options.centre[axis] + random.uniform(i, axis, -options.box, options.box));
  const std::vector<std::array<std::uint8_t, 3>> colours(points, {127, 127, 127});
  return initialise_from_points(dim, positions, colours, seed, options);
}

}  // namespace ubs
