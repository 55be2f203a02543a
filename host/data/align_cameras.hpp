// SPDX-License-Identifier: Apache-2.0
// Poses that are nearly right, from corners that several pictures of a still scene show (bundle adjustment).
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "host/scene/dataset.hpp"

namespace ubs {

struct Alignment {
  std::vector<Camera> cameras;  // by view; given ones where a picture has too few corners
  std::size_t points = 0, aligned = 0;
  double before = 0, after = 0;  // [px] between corners and their points, medians
};

// Its time grows with the cube of the views, and it takes half a GiB for this many.
inline constexpr std::size_t kMaxAlignedViews = 300;

// Corners (SIFT) are matched between neighbours along the lines that the cameras prescribe, in a band that
// narrows with the error. Points and poses then move together until the points are where the corners are
// (method.md 4.10). Nothing is aligned where pictures have no texture, of more than kMaxAlignedViews, and in
// a build without OpenCV. The same cameras at every call.
Alignment align_cameras(std::span<const View> views);

}  // namespace ubs
