// SPDX-License-Identifier: Apache-2.0
// resize_bicubic() resizes 8-bit RGB images with an antialiased bicubic filter. The result has the same bytes
// as that of Pillow's Image.resize with its default filter, which was used for the published scores
// (method.md 4.5). OpenCV has no equivalent: INTER_CUBIC does not widen the kernel when it reduces an image,
// and INTER_AREA is a box filter.
#pragma once

#include "host/scene/dataset.hpp"

namespace ubs {

Image8 resize_bicubic(const Image8& image, int width, int height);

}  // namespace ubs
