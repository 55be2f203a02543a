// SPDX-License-Identifier: Apache-2.0
// reduce_splats() converts a model to Gaussians for third-party formats. It takes the splats at a fixed time,
// averages their positions, shapes and opacities over the view direction, and replaces the Beta kernel by the
// nearest Gaussian. Colours, including spherical harmonics, are kept. `ubs convert --data` measures the loss
// of quality by rendering. Models that already consist of Gaussians are converted without loss by the
// functions of gaussian_model.hpp.
#pragma once

#include <array>
#include <span>
#include <string>
#include <vector>

#include "host/formats/imported_splats.hpp"
#include "host/scene/splat_model.hpp"

namespace ubs {

struct ReduceOptions {
  double time = 0;  // time at which the model is converted, from 0 to 1
  // How the opacities of all directions are combined. "mean" takes the mean, which is the best approximation
  // in least squares if all directions are equally important. "weighted" takes the mean weighted by the
  // opacities, so that splats that are visible from only some directions stay more opaque. "max" takes the
  // maximum.
  std::string opacity = "mean";
  // Positions that the model is viewed from. If empty, 32 directions spread evenly over the sphere are used.
  std::vector<std::array<double, 3>> viewpoints;
  // Splats whose combined opacity is below this value are dropped, because viewers skip them.
  float least_opacity = 1.0f / 255;
};

// Converts the model. Throws Error(usage) if no Gaussian can replace the kernel of the model, if the model
// has more than three dimensions and a variant that Slicer does not support, or if options.opacity is not
// "mean", "weighted" or "max".
ImportedSplats reduce_splats(const SplatModel& model, const ReduceOptions& options = {});

}  // namespace ubs
