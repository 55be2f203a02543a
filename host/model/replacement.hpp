// SPDX-License-Identifier: Apache-2.0
// Replacement describes a splat that replaces a splat with more dimensions. The new splat lacks some of the
// query dimensions: the direction, the time and the further values, or all of them. Its opacity and mean are
// the constants that fit best over the views in which the original splat is visible.
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

// DimensionEffect describes the effect of the removed dimensions on a splat in the views in which it is
// visible.
struct DimensionEffect {
  // Maximum minus minimum of an opacity ratio over the views. The ratio is the opacity of the original splat
  // in a view, divided by the opacity of the replacement.
  double opacity = 0;
  double shift_px = 0;  // maximum distance between the conditional mean and the mean of the replacement [px]
  double change = 0;    // estimate of the maximum change of the blended weight of the splat in a pixel
  // True if the removed dimensions have no effect for any query, so that the replacement renders
  // bit-identical images.
  bool exact = false;
};

struct Replacement {
  int dim = 3;
  DimensionEffect effect;
  std::vector<float> values;  // raw parameters in the layout of `dim`; empty if the change is too large
};

// SplatViews holds the cameras of the views, and the maximum blended weight of one splat in each view. The
// weight is 0 if the splat is not visible in a view.
struct SplatViews {
  std::span<const Camera> cameras;
  std::span<const float> weights;
  double eps2d = 0.3;  // blur of the renderer [px^2]
};

// Returns one replacement for each number of dimensions in smaller_dims(). If the splat is not visible in any
// view, only exact replacements are returned. Replacements that change a weight by more than `worst` have no
// values, because computing the values is slow. The result is empty for variants that Slicer does not
// support, and for direct conditioning, because splats with direct conditioning have no covariance.
std::vector<Replacement> replacements(const SplatModel& model, std::size_t splat, const SplatViews& views,
                                      double worst);

}  // namespace ubs::reduce
