// SPDX-License-Identifier: Apache-2.0
// What an image file says about itself before it is decoded: size and orientation tag. PNG and JPEG are
// read from their headers, so that thousands of files cost no decoding; other formats are decoded.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "host/data/image.hpp"

namespace ubs {

struct ImageInfo {
  ImageSize size;
  int orientation = 1;  // EXIF tag 0x0112 of a JPEG file; 1: upright. It is reported, never applied.
  bool opaque = false;  // has no alpha, and no clear colour of a PNG
};

ImageInfo image_file_info(const std::filesystem::path& path);

// Throws Error(data) that names the format where the first bytes of a file are those of AVIF, HEIC, GIF and
// the like, which are not supported.
void refuse_unread_format(std::string_view head, const std::string& name);

// Of a format whose header is not read here, by decoding the file.
ImageInfo decoded_info(const std::filesystem::path& path);

}  // namespace ubs
