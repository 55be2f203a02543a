// SPDX-License-Identifier: Apache-2.0
// decode_jpeg() decodes JPEG files with TurboJPEG and treats its warnings as errors. OpenCV is not used
// because it ignores these warnings: for a truncated or damaged file, OpenCV returns an image whose lower
// part is grey or shifted, and prints no message.
#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <span>
#include <string>

namespace ubs {

bool is_jpeg(std::span<const std::byte> file);

// Returns the stored pixels, which are grey or have the channels B, G, R. The orientation tag is not applied.
// Files with four components (CMYK) are decoded only to check them for damage; for these, the function
// returns an empty matrix, and the caller decodes them again with OpenCV, which converts their colours.
// Throws Error(data) for every error and warning of TurboJPEG, and if the file is too short for its number of
// pixels. The message starts with `name`.
cv::Mat decode_jpeg(std::span<const std::byte> file, const std::string& name);

}  // namespace ubs
