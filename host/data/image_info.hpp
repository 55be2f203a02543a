// SPDX-License-Identifier: Apache-2.0
// ImageInfo holds properties of an image file that are known before decoding: size, orientation tag and
// opacity. For PNG and JPEG only the header is read, so that opening thousands of files is fast; other
// formats are decoded.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "host/data/image.hpp"

namespace ubs {

struct ImageInfo {
  ImageSize size;
  // EXIF tag 0x0112 of a JPEG file; 1: upright. ubs reports it, but never applies it.
  int orientation = 1;
  bool opaque = false;  // has no alpha, and no transparent colour (PNG)
};

ImageInfo image_file_info(const std::filesystem::path& path);

// Throws Error(data) that names the format if the first bytes of a file are those of an unsupported format,
// such as AVIF, HEIC or GIF.
void refuse_unread_format(std::string_view head, const std::string& name);

// Decodes the file to get its properties; used for formats whose header is not read here.
ImageInfo decoded_info(const std::filesystem::path& path);

}  // namespace ubs
