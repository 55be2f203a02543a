// SPDX-License-Identifier: Apache-2.0
// reduce_splats() converts a model to Gaussians for third-party formats. It fixes the time, averages over the
// view direction (spherical harmonics are kept), and replaces the Beta kernel by the nearest Gaussian. `ubs
// convert --data` measures the loss of quality by rendering. Models that already consist of Gaussians are
// converted without loss by gaussian_model.hpp.
#pragma once

#include <array>
#include <span>
#include <string>
#include <vector>

#include "host/data/imported_splats.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs {

struct ReduceOptions {
  double time = 0;
  // How to combine the opacities of all directions. mean: the mean, which is optimal in least squares if all
  // directions count alike. weighted: the mean weighted by the opacity itself, so that splats which are
  // visible from anywhere stay opaque. max: the maximum.
  std::string opacity = "mean";
  // Positions that the model is viewed from. If empty, 32 directions spread evenly over the sphere are used.
  std::vector<std::array<double, 3>> viewpoints;
  // Splats below this opacity from all directions are dropped, because viewers skip them.
  float least_opacity = 1.0f / 255;
};

// Returns support / sigma of the Gaussian nearest to a Beta kernel. The formula fits the min-max optima of
// method.md 2.7 within 0.5% (beta 4, 6.6, 10.9, 29.6).
double support_ratio(double beta);

// Throws Error(usage) for variants of more than three dimensions that Slicer does not support.
ImportedSplats reduce_splats(const SplatModel& model, const ReduceOptions& options = {});

}  // namespace ubs
