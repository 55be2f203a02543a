// SPDX-License-Identifier: Apache-2.0
// A splat with fewer dimensions in the place of one with more: direction or time and further values no longer
// act on it, and what they did is replaced by the best constant over the views in which the splat is seen.
#pragma once

#include <span>
#include <vector>

#include "host/scene/camera.hpp"
#include "host/scene/mixed_model.hpp"

namespace ubs::reduce {

// Dimensions that a splat of N can be turned into, smallest first: without direction, without time and
// further values, or without both, as far as N expresses it (kernels/layout.h): 7 -> 3, 4, 6.
std::vector<int> smaller_dims(int dim);

// What becomes of a splat between the views when its dimensions act: ranges over the views that see it.
struct DimensionEffect {
  double opacity = 0;   // largest - smallest factor of the conditioned opacity that the constant replaces
  double shift_px = 0;  // largest distance of the conditional mean from its replacement [px]
  double change = 0;    // estimate of the largest change of a pixel's blended weight
  // The dimensions have no effect at all, at any query: the replacement draws the same bits.
  bool exact = false;
};

struct Replacement {
  int dim = 3;
  DimensionEffect effect;
  std::vector<float> values;  // raw parameters of the layout of `dim`; empty where nothing fits
};

// What the views say about one splat: cameras, and its largest blended weight in each (0: not seen).
struct SplatViews {
  std::span<const Camera> cameras;
  std::span<const float> weights;
  double eps2d = 0.3;  // blur of the renderer [px^2]
};

// One for each of smaller_dims. `worst`: where the change is larger, no values are made (they are the costly
// part). Of a form that Slicer does not know only exact replacements are found.
std::vector<Replacement> replacements(const SplatModel& model, std::size_t splat, const SplatViews& views,
                                      double worst);

}  // namespace ubs::reduce
