// SPDX-License-Identifier: Apache-2.0
// Decodes PNG files with libpng. ubs calls it directly, so that messages of libpng become errors of ubs;
// through OpenCV, libpng prints them to stderr in addition.
//
// libpng's simplified interface (png_image) would be shorter, but it changes pixels: it converts 8-bit files
// to sRGB, and 16-bit files to linear light with premultiplied alpha. Of 524 files of all kinds (libpng
// 1.6.39), 188 change:
// - 8-bit files whose gAMA chunk is not about 45455, by up to 9 of 255 for 50000 and up to 72 for 100000
// - 16-bit files with an sRGB chunk or a gAMA chunk other than 100000, by up to 18530 of 65535
// - all 16-bit files with alpha, by up to 65130
// It also only warns about a damaged tRNS chunk, does not check the end of the file, and takes twice as long.
#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <span>
#include <string>

namespace ubs {

bool is_png(std::span<const std::byte> file);

// Returns the stored values, without applying gamma or a colour profile, with 8 or 16 bits each. The channels
// are grey; B, G, R; or B, G, R, alpha (also for grey with alpha). Throws Error(data) whose message starts
// with `name` for everything that libpng reports, including wrong checksums of any chunk, and for image sizes
// that a file of this length cannot hold.
cv::Mat decode_png(std::span<const std::byte> file, const std::string& name);

}  // namespace ubs
