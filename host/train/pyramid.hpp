// SPDX-License-Identifier: Apache-2.0
// With an image pyramid, training starts with reduced images (docs/budget.md). The functions of this file
// determine the factor by which images and cameras are reduced at an iteration, and reduce them. The factor
// depends only on the settings and the data, so that a run can be resumed at any iteration.
#pragma once

#include <vector>

#include "host/scene/dataset.hpp"
#include "host/settings/work_share.hpp"

namespace ubs {

struct PyramidLevel {
  int factor = 1;    // the width and the height of the training images are divided by this factor
  double until = 0;  // share of the work at which the level ends
  bool operator==(const PyramidLevel&) const = default;
};

// Minimum width and height of a reduced image [px]. Smaller images show too little detail.
inline constexpr int kMinShortSide = 64;

// Returns the levels of a run with the views `train`. The last level has the factor 1 and lasts until the
// end. A factor for which a side of a view would be shorter than kMinShortSide is halved until all sides are
// long enough.
std::vector<PyramidLevel> pyramid_levels(const TrainSettings& settings, const Split& train);
// Returns the factor at an iteration (counted from 1), or at a share of the work.
int factor_at(const std::vector<PyramidLevel>& levels, const WorkShare& work, int iteration);
int factor_at(const std::vector<PyramidLevel>& levels, double share);

// Returns the camera whose pixels cover factor x factor pixels of `camera`. Remaining pixels at the right and
// bottom edges are cropped.
Camera reduced(const Camera& camera, int factor);
// Returns the reduced image. Each pixel is the rounded mean of its square of factor x factor pixels. If the
// image has a mask, the mean is computed from the pixels that are not masked. The reduced pixel is masked if
// more than half of the pixels of its square are masked.
Image8 reduced(const Image8& image, int factor);

}  // namespace ubs
