// SPDX-License-Identifier: Apache-2.0
// align_cameras() corrects slightly wrong camera poses. It uses corners (SIFT keypoints) that several images
// of a still scene show (bundle adjustment).
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "host/scene/dataset.hpp"

namespace ubs {

struct Alignment {
  // One per view. A view whose image has too few corners keeps its given camera.
  std::vector<Camera> cameras;
  std::size_t points = 0, aligned = 0;
  double before = 0, after = 0;  // [px] median distance between corners and their projected points
};

// The running time grows with the cube of the number of views; this many need half a GiB of memory.
inline constexpr std::size_t kMaxAlignedViews = 300;

// Finds SIFT corners and matches them between neighbouring views along the epipolar lines of the given
// cameras. The search band around these lines gets narrower as the error gets smaller. Points and poses are
// then adjusted together until the points project to their corners (method.md 4.10). The given cameras are
// returned unchanged if the images have no texture, if there are more than kMaxAlignedViews, or in a build
// without OpenCV. Deterministic: repeated calls return the same cameras.
Alignment align_cameras(std::span<const View> views);

}  // namespace ubs
