// SPDX-License-Identifier: Apache-2.0
// Decodes JPEG files with TurboJPEG and treats its warnings as errors. OpenCV ignores these warnings, and a
// file that is cut off or damaged then gives an image that is grey or shifted below some row, without any
// message.
#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <span>
#include <string>

namespace ubs {

bool is_jpeg(std::span<const std::byte> file);

// Returns the stored pixels, grey or in the order B, G, R; the orientation tag is not applied. Returns an
// empty matrix for files of four components (CMYK): these are decoded too, so that damage is found, but their
// colours are left to OpenCV. Throws Error(data) that starts with `name` for everything that TurboJPEG
// reports, and for sizes that a file of this length cannot hold.
cv::Mat decode_jpeg(std::span<const std::byte> file, const std::string& name);

}  // namespace ubs
