// SPDX-License-Identifier: Apache-2.0
// Decodes PNG files with libpng, so that its messages become our errors: through OpenCV, libpng prints them
// on stderr beside ours.
//
// libpng's simplified interface (png_image) would be shorter, but it changes pixels: it converts files of 8
// bits to sRGB, and those of 16 bits to linear light with premultiplied alpha. Of 524 files of all kinds
// (libpng 1.6.39), 188 change: those of 8 bits whose gAMA chunk is not about 45455, by up to 9 of 255 for
// 50000 and up to 72 for 100000; those of 16 bits with an sRGB chunk or a gAMA chunk other than 100000, by up
// to 18530 of 65535; and all of 16 bits with alpha, by up to 65130. It also only warns of a damaged tRNS
// chunk, does not look at the end of the file, and takes twice as long.
#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <span>
#include <string>

namespace ubs {

bool is_png(std::span<const std::byte> file);

// Returns the stored values, without any gamma or colour profile, 8 or 16 bits each: grey, B, G, R, or B, G,
// R, alpha (grey with alpha too). Throws Error(data) that starts with `name` for everything that libpng
// reports, including checksums of all chunks, and for sizes that a file of this length cannot hold.
cv::Mat decode_png(std::span<const std::byte> file, const std::string& name);

}  // namespace ubs
