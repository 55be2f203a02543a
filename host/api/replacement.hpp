// SPDX-License-Identifier: Apache-2.0
// Replacement is a splat that replaces one with more dimensions. The direction, or time and further values,
// or all of these, no longer affect the new splat. Their effect is replaced by the constant that fits best
// over the views in which the splat is visible.
#pragma once

#include <span>
#include <vector>

#include "host/scene/camera.hpp"
#include "host/scene/mixed_model.hpp"

namespace ubs::reduce {

// Returns the numbers of dimensions that a splat of N dimensions can be reduced to, smallest first. The
// reduced splat lacks the direction, or time and further values, or both, if a layout for that combination
// exists (kernels/layout.h). For example, 7 can be reduced to 3, 4 and 6.
std::vector<int> smaller_dims(int dim);

// The effect that the removed dimensions have on a splat: ranges over the views that see it.
struct DimensionEffect {
  double opacity = 0;   // maximum - minimum factor of the conditioned opacity that the constant replaces
  double shift_px = 0;  // maximum distance of the conditional mean from its replacement [px]
  double change = 0;    // estimate of the maximum change of a pixel's blended weight
  // The dimensions have no effect for any query, so the replacement renders bit-identical images.
  bool exact = false;
};

struct Replacement {
  int dim = 3;
  DimensionEffect effect;
  std::vector<float> values;  // raw parameters in the layout of `dim`; empty if the change is too large
};

// One splat as seen in the views: the cameras, and its maximum blended weight in each view (0: not visible).
struct SplatViews {
  std::span<const Camera> cameras;
  std::span<const float> weights;
  double eps2d = 0.3;  // blur of the renderer [px^2]
};

// Returns replacements for the entries of smaller_dims. An entry is left out if no view sees the splat and
// the replacement is not exact. If the change is larger than `worst`, the values are not computed, because
// that is the expensive part. The result is empty for variants that Slicer does not support, and for direct
// conditioning, which has no covariance.
std::vector<Replacement> replacements(const SplatModel& model, std::size_t splat, const SplatViews& views,
                                      double worst);

}  // namespace ubs::reduce
