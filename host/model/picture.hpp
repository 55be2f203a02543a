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

// Returns the range from the 1st to the 99th percentile of the depths, or {0, 0} if there are no depths.
DepthRange depth_percentiles(std::vector<float> depths);
// Returns the range of depths (see depth_percentiles) of the pixels whose alpha is above 0.5. The range is
// empty if there are no such pixels, or if all of them have the same depth.
DepthRange depth_range(const RenderedView& view);
// Returns the smallest range that contains both; an empty range is ignored.
DepthRange united(const DepthRange& a, const DepthRange& b);

// Returns one channel of a rendered view as an image. Depth is shown in the colours of the Turbo colour map,
// from red at range.near to blue at range.far, multiplied by alpha. Alpha is shown in grey. `range` is only
// used for depth. Throws Error(numerical) if a value of the channel is not finite.
Image8 picture(const RenderedView& view, Channel channel, const DepthRange& range = {});

}  // namespace ubs
