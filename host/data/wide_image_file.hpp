// SPDX-License-Identifier: Apache-2.0
// wide_image() describes an image file of a wide lens for WideImage (host/scene/wide_image.hpp).
#pragma once

#include <memory>

#include "host/data/image_source.hpp"
#include "host/data/lens_image.hpp"
#include "host/scene/wide_image.hpp"

namespace ubs {

// `lens` has the size of the delivered image, and `image` needs no undistortion. The functions of the result
// throw Error if LensImage does.
std::shared_ptr<const WideImage> wide_image(const WideLens& lens, const FileImage& image);

}  // namespace ubs
