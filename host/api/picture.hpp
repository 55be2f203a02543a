// SPDX-License-Identifier: Apache-2.0
// What a rendered view looks like on a screen: colour, or depth and alpha as pictures.
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

// From the 1st to the 99th percentile; {0, 0} of none.
DepthRange depth_percentiles(std::vector<float> depths);
// Of pixels with alpha above a half; empty without such pixels or when they are all alike.
DepthRange depth_range(const RenderedView& view);
// From the nearer to the farther of two; an empty one does not count.
DepthRange united(const DepthRange& a, const DepthRange& b);

// Depth by Turbo's colours, red near and blue far, darkened by missing alpha; grey for alpha. A value that is
// not finite is an error (host/data/image.hpp). `range` is for depth alone.
Image8 picture(const RenderedView& view, Channel channel, const DepthRange& range = {});

}  // namespace ubs
