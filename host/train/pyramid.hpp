// SPDX-License-Identifier: Apache-2.0
// The image pyramid lets training start on coarse images (docs/budget.md). This file determines the factor by
// which images and cameras are reduced at an iteration, and reduces them. The factor depends only on the
// settings and the data, so that a run can be resumed at any iteration.
#pragma once

#include <vector>

#include "host/scene/dataset.hpp"
#include "host/train/work_share.hpp"

namespace ubs {

struct PyramidLevel {
  int factor = 1;    // both sides of every training image are divided by it
  double until = 0;  // share of the work at which the level ends
  bool operator==(const PyramidLevel&) const = default;
};

// Minimum side of a reduced image [px]; smaller images show too little of the scene.
inline constexpr int kMinShortSide = 64;

// Returns the levels of a run on these views. The last level has factor 1 and lasts until the end. If a
// factor would make a side of a view shorter than kMinShortSide, it is halved until this is no longer the
// case.
std::vector<PyramidLevel> pyramid_levels(const TrainSettings& settings, const Split& train);
// Returns the factor at an iteration (counted from 1), or at a share of the work.
int factor_at(const std::vector<PyramidLevel>& levels, const WorkShare& work, int iteration);
int factor_at(const std::vector<PyramidLevel>& levels, double share);

// Returns the camera whose pixels cover factor x factor pixels of `camera`. Remaining pixels at the right and
// bottom edges are cropped.
Camera reduced(const Camera& camera, int factor);
// Returns the reduced image. Each pixel is the rounded mean of its square of factor x factor pixels. If the
// image has a mask, the mean is over the pixels that count, and the reduced pixel counts if at least half of
// its square does.
Image8 reduced(const Image8& image, int factor);

}  // namespace ubs
