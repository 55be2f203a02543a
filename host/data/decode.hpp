// SPDX-License-Identifier: Apache-2.0
// Decoding of image files for the other files of this folder (keeps OpenCV out of image.hpp).
#pragma once

#include <filesystem>
#include <opencv2/core.hpp>

namespace ubs {

// 8 or 16 bits or float, 1, 3 or 4 channels in the order B, G, R(, A). Orientation tags are ignored.
cv::Mat decode_image_file(const std::filesystem::path& path);

}  // namespace ubs
