// SPDX-License-Identifier: Apache-2.0
// initialise_random() and initialise_from_points() create the initial parameters of a model (method.md 1.3).
// All random numbers come from a counter-based generator, so the result depends only on the arguments, not on
// threads or the standard library.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "host/scene/splat_model.hpp"

namespace ubs {

struct InitOptions {
  double box = 1.3;  // half the side of the cube, around `centre`, that random points fill
  std::array<double, 3> centre{0, 0, 0};
  double opacity = 0.5;
  // Raw betas of the direction. If empty, they are -3 if N = 7 and the weights of the query dimensions are
  // not learnt, and 0 in all other cases.
  std::optional<double> beta_dir;
  double beta_query = 0;  // raw betas of the other query dimensions
  ModelVariant variant;
  // The initial scale of a splat is the distance of its neighbours divided by this ratio. If it is empty, the
  // ratio is that of the kernel (SpatialKernelRow::initial_ratio).
  std::optional<double> initial_ratio;
};

// These functions create a model with N = `dim`. The query dimensions are: for N = 4 the time, for N = 5 the
// time and one further value, and for N >= 6 three dimensions of the direction, then the time, then further
// values.
SplatModel initialise_random(int dim, std::size_t points, std::uint64_t seed,
                             const InitOptions& options = {});

SplatModel initialise_from_points(int dim, std::span<const std::array<float, 3>> positions,
                                  std::span<const std::array<std::uint8_t, 3>> colours, std::uint64_t seed,
                                  const InitOptions& options = {});

// Returns for each point the root of the mean squared distance to its three nearest neighbours, or to all
// other points if there are fewer than three. The result is at least 1e-7. Duplicates count as neighbours at
// distance 0. A single point gets 0.1.
std::vector<double> neighbour_distances(std::span<const std::array<float, 3>> positions);

}  // namespace ubs
