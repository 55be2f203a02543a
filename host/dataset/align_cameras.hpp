// SPDX-License-Identifier: Apache-2.0
// align_cameras() corrects slightly wrong camera poses of a static scene. It does a bundle adjustment of
// corners (SIFT keypoints) that are visible in several images.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "host/scene/dataset.hpp"

namespace ubs {

struct Alignment {
  // The corrected cameras, one per view. A view whose image has too few corners keeps its given camera.
  std::vector<Camera> cameras;
  // Number of points that the final poses were computed from, and number of cameras that were corrected.
  std::size_t points = 0, aligned = 0;
  // [px] median distance between corners and their projected points, before and after the alignment
  double before = 0, after = 0;
};

// Maximum number of views that are aligned. The running time grows with the cube of the number of views, and
// 300 views need half a GiB of memory.
inline constexpr std::size_t kMaxAlignedViews = 300;

// Finds SIFT corners and matches them between neighbouring views along the epipolar lines of the given
// cameras. The search band around these lines gets narrower as the error gets smaller. Points and poses are
// then adjusted together until the points project to their corners (method.md 4.10). The given cameras are
// returned unchanged if fewer than half of them can be aligned (for example, because the images have no
// texture), if the median error does not decrease, if there are more than kMaxAlignedViews views, or in a
// build without OpenCV. The function is deterministic: repeated calls return the same cameras.
Alignment align_cameras(std::span<const View> views);

}  // namespace ubs
