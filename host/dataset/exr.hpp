// SPDX-License-Identifier: Apache-2.0
// decode_exr() decodes OpenEXR files with the OpenEXR library. OpenCV's decoder is not used, because it takes
// the data window for the picture, and does not read layers.
#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <span>
#include <string>

namespace ubs {

bool is_exr(std::span<const std::byte> file);

// Returns the pixels of the display window as floats: Y, or B, G, R, or B, G, R, alpha. Colours are linear
// light, multiplied by alpha. Pixels of the display window that are outside of the data window are 0. If the
// file has layers or parts, the picture is the one without a name, or Blender's pass "Combined", or the only
// one with colours. Throws Error(data) for all errors of the library, for deep images, and if it is not clear
// which layer is the picture. The message starts with `name`.
cv::Mat decode_exr(std::span<const std::byte> file, const std::string& name);

}  // namespace ubs
