// SPDX-License-Identifier: Apache-2.0
// RenderedView is a copy of a rendered view in host memory. Its rows have no padding, and the three colour
// values of a pixel are adjacent.
#pragma once

#include <vector>

namespace ubs {

struct RenderedView {
  int width = 0, height = 0;
  std::vector<float> rgb;    // (height, width, 3), not clamped
  std::vector<float> alpha;  // (height, width)
  std::vector<float> depth;  // (height, width), empty unless KernelConfig::depth
};

}  // namespace ubs
