// SPDX-License-Identifier: Apache-2.0
// Values and gradients of sweep cases in extended precision (wide_tape.hpp), from the oracle's own formulas.
#pragma once

#include <span>
#include <vector>

#include "host/stress/sweep_cases.hpp"

namespace ubs::stress {

// A splat seen at points of its support: colours there, and the gradient of sum(v_image colour) to the raw
// parameters.
struct SplatReference {
  bool visible = false;
  std::vector<double> image;     // r, g, b planes of kSweepPoints
  std::vector<double> gradient;  // by parameter row
};

// Points spread over the support, at r up to radius2 and no further than `reach` pixels from the mean; as
// floats. False when the splat is not visible.
bool choose_points(const SweepSet& set, const SweepSplat& splat, Generator& g, std::vector<float>& x,
                   std::vector<float>& y);
// raw: the splat's parameters, possibly moved by less than an ulp.
SplatReference splat_reference(const SweepSet& set, std::span<const double> raw, std::span<const float> x,
                               std::span<const float> y, std::span<const float> v_image);

// Gradient per layer to mean (2), ellipse W (3), opacity, beta, rgb (3), in kernels/layout.h's order.
struct StackReference {
  std::vector<double> image, gradient;
};
StackReference stack_reference(std::span<const double> fields, std::span<const float> x,
                               std::span<const float> y, std::span<const float> v_image);

}  // namespace ubs::stress
