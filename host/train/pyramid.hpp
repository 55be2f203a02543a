// SPDX-License-Identifier: Apache-2.0
// Training on coarse images first (docs/budget.md): which factor images and cameras are reduced by at an
// iteration, and the reduction itself. A function of settings and data alone, so that a run can be resumed
// anywhere.
#pragma once

#include <vector>

#include "host/scene/dataset.hpp"
#include "host/train/work_share.hpp"

namespace ubs {

struct PyramidLevel {
  int factor = 1;    // both sides of every training image are divided by it
  double until = 0;  // share of the work where it ends
  bool operator==(const PyramidLevel&) const = default;
};

inline constexpr int kMinShortSide = 64;  // of a reduced image [px]: less than that holds no scene

// The levels of a run over these views, the last one of factor 1 and until the end. A factor that would
// leave a view with a side shorter than kMinShortSide is halved until none is.
std::vector<PyramidLevel> pyramid_levels(const TrainSettings& settings, const Split& train);
// The factor of an iteration counted from 1, and of a share of the work.
int factor_at(const std::vector<PyramidLevel>& levels, const WorkShare& work, int iteration);
int factor_at(const std::vector<PyramidLevel>& levels, double share);

// The camera whose pixels are squares of factor x factor pixels; a rest at the right and bottom edge is cut.
Camera reduced(const Camera& camera, int factor);
// Each pixel is the mean of its square, rounded; where there is a mask, of what counts there, and it counts
// where half of the square does.
Image8 reduced(const Image8& image, int factor);

}  // namespace ubs
