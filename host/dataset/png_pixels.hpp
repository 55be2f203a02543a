// SPDX-License-Identifier: Apache-2.0
// decode_png() decodes PNG files with libpng. ubs calls libpng directly, so that error messages of libpng
// become errors of ubs. When OpenCV calls libpng, they are also printed to stderr.
//
// libpng's simplified interface (png_image) is not used, although it needs less code, because it changes
// pixels: it converts 8-bit files to sRGB, and 16-bit files to linear light with premultiplied alpha. In a
// test with 524 files of all kinds (libpng 1.6.39), it changed the pixels of 188 files. These were:
// - 8-bit files whose gAMA chunk is not about 45455. Values from 0 to 255 change by up to 9 if gAMA is
//   50000, and by up to 72 if it is 100000.
// - 16-bit files with an sRGB chunk, or with a gAMA chunk other than 100000. Values from 0 to 65535 change
//   by up to 18530.
// - all 16-bit files with alpha. Values from 0 to 65535 change by up to 65130.
// The simplified interface also only warns about a damaged tRNS chunk, does not check the end of the file,
// and takes twice as long.
#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <span>
#include <string>

namespace ubs {

bool is_png(std::span<const std::byte> file);

// Returns the stored values with 8 or 16 bits per sample. Gamma and colour profiles are not applied. Grey
// images have one channel, colour images have the channels B, G, R, and images with alpha or a transparent
// colour, including grey ones, have the channels B, G, R, alpha. Throws Error(data) for all errors of libpng,
// for a wrong checksum of any chunk, and if the file is too short for its number of pixels. The message
// starts with `name`. Warnings of libpng are ignored.
cv::Mat decode_png(std::span<const std::byte> file, const std::string& name);

}  // namespace ubs
