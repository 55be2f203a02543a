// SPDX-License-Identifier: Apache-2.0
// Our splats as Gaussians for files of other tools: time fixed, dependence on the direction averaged
// away (harmonics are kept), the Beta kernel replaced by the Gaussian nearest to it. What that costs is
// measured by rendering (ubs convert --data). Models that are Gaussians already need none of it:
// gaussian_model.hpp.
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
  // Opacity over the directions: mean (least squares when every direction counts alike), weighted (mean
  // weighted with the opacity itself: what is visible at all stays solid), max.
  std::string opacity = "mean";
  // Places that the model is looked at from; empty: 32 directions spread evenly over the sphere.
  std::vector<std::array<double, 3>> viewpoints;
  float least_opacity = 1.0f / 255;  // splats below it from everywhere are dropped; viewers skip them
};

// sigma = support / ratio: fits the min-max optima of method.md 2.7 within 0.5% (beta 4, 6.6, 10.9, 29.6).
double support_ratio(double beta);

// Throws Error(usage) for forms of more than three dimensions that Slicer does not know.
ImportedSplats reduce_splats(const SplatModel& model, const ReduceOptions& options = {});

}  // namespace ubs
