// SPDX-License-Identifier: Apache-2.0
// Starting parameters of a model (method.md 1.3). All draws come from a counter-based generator: the
// result is a function of the arguments, not of threads or of the standard library.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "host/scene/splat_model.hpp"

namespace ubs {

struct InitOptions {
  double box = 1.3;  // random points fill [-box, box]^3 around the centre
  std::array<double, 3> centre{0, 0, 0};
  double opacity = 0.5;
  std::optional<double> beta_dir;  // raw direction betas; default -3 for N = 7, else 0 as published
  double beta_query = 0;           // raw betas of the other query dimensions
  ModelVariant variant;
  // Gaussians start with the distance of their neighbours over this as deviation. 3.08 is the support radius
  // over the deviation of the Gaussian nearest to (1 - r)^4 (method.md 2.7). With 1, as 3DGS starts, it is an
  // opaque fog: at the learning rates of the Beta kernel training on lego_200 from 30 000 random points ended
  // at 9.8 dB.
  double gaussian_ratio = 3.08;
};

// Query dimensions: N = 4 time; N = 5 time and one further value; N >= 6 three of direction, then
// time, then further values.
SplatModel initialise_random(int dim, std::size_t points, std::uint64_t seed,
                             const InitOptions& options = {});

SplatModel initialise_from_points(int dim, std::span<const std::array<float, 3>> positions,
                                  std::span<const std::array<std::uint8_t, 3>> colours, std::uint64_t seed,
                                  const InitOptions& options = {});

// Root of the mean squared distance to the three nearest other points (fewer where there are fewer),
// at least 1e-7. Duplicates count as neighbours at distance 0. A single point gets 0.1.
std::vector<double> neighbour_distances(std::span<const std::array<float, 3>> positions);

}  // namespace ubs
