// SPDX-License-Identifier: Apache-2.0
// picture() converts a rendered view to an image for display: colour, depth or alpha.
#pragma once

#include <string_view>
#include <vector>

#include "host/pipeline/renderer.hpp"
#include "host/scene/dataset.hpp"

namespace ubs {

enum class Channel { rgb, alpha, depth };

struct DepthRange {
  float near = 0, far = 0;
  bool empty() const { return !(far > near); }
};

// Returns the range from the 1st to the 99th percentile; {0, 0} if there are no depths.
DepthRange depth_percentiles(std::vector<float> depths);
// Returns the depth range of the pixels with alpha above 0.5. Empty if there are no such pixels or if all
// have the same depth.
DepthRange depth_range(const RenderedView& view);
// Returns the smallest range that contains both; an empty range is ignored.
DepthRange united(const DepthRange& a, const DepthRange& b);

// Depth is shown in the Turbo colour map, red for near and blue for far, and darker where alpha is below 1;
// alpha is shown in grey. A value that is not finite is an error (host/data/image.hpp). `range` is only used
// for depth.
Image8 picture(const RenderedView& view, Channel channel, const DepthRange& range = {});

}  // namespace ubs
