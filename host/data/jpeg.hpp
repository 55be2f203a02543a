// SPDX-License-Identifier: Apache-2.0
// Decodes JPEG files with TurboJPEG and treats its warnings as errors. OpenCV ignores these warnings: for a
// truncated or damaged file it returns, without any message, an image that is grey or shifted below some row.
#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <span>
#include <string>

namespace ubs {

bool is_jpeg(std::span<const std::byte> file);

// Returns the stored pixels, grey or in the order B, G, R; does not apply the orientation tag. Files with
// four components (CMYK) are decoded only to find damage: the function returns an empty matrix, and OpenCV
// converts their colours. Throws Error(data) whose message starts with `name` for everything that TurboJPEG
// reports, and for image sizes that a file of this length cannot hold.
cv::Mat decode_jpeg(std::span<const std::byte> file, const std::string& name);

}  // namespace ubs
