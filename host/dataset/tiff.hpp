// SPDX-License-Identifier: Apache-2.0
// decode_tiff() decodes TIFF files with libtiff. OpenCV's decoder is not used, because it multiplies colours
// by alpha, also those that are stored multiplied, and rotates the pixels as the orientation demands.
#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <span>
#include <string>

namespace ubs {

struct TiffImage {
  // 8 or 16 bits per sample. Grey images have one channel, colour images have the channels B, G, R, and
  // images with alpha, including grey ones, have the channels B, G, R, alpha.
  cv::Mat pixels;
  bool premultiplied = false;  // the colours are multiplied by alpha ("associated" alpha)
  int orientation = 1;         // tag Orientation, which is not applied
};

bool is_tiff(std::span<const std::byte> file);

// Decodes the first page that is neither a reduced copy of another page nor a mask. Palettes, CMYK, YCbCr,
// L*a*b* and "minimum is white" become RGB or grey. Gamma and colour profiles are not applied. Throws
// Error(data) for all errors of libtiff and for files that it can read but whose pixels have no defined
// colour here, for example floating-point samples, which may be linear light or not. The message starts with
// `name`.
TiffImage decode_tiff(std::span<const std::byte> file, const std::string& name);

}  // namespace ubs
