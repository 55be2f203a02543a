// SPDX-License-Identifier: Apache-2.0
// Antialiased bicubic resizing of 8-bit RGB that gives the bytes of Pillow's Image.resize, whose
// default the published scores rest on (method.md 4.5). OpenCV has no equivalent: its INTER_CUBIC does
// not widen the kernel when shrinking, INTER_AREA is a box filter.
#pragma once

#include "host/scene/dataset.hpp"

namespace ubs {

Image8 resize_bicubic(const Image8& image, int width, int height);

}  // namespace ubs
