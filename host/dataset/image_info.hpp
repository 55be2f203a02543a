// SPDX-License-Identifier: Apache-2.0
// ImageInfo holds properties of an image file that are known before decoding: size, orientation tag and
// opacity. For PNG and JPEG only the header is read, so that opening thousands of files is fast; other
// formats are decoded.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <string_view>

#include "host/dataset/image.hpp"

namespace ubs {

struct ImageInfo {
  ImageSize size;
  // Tag 0x0112 of a TIFF file or of the EXIF data of a JPEG file; 1 means upright. ubs reports the tag, but
  // never rotates the image.
  int orientation = 1;
  bool opaque = false;  // the file has neither an alpha channel nor a transparent colour (PNG)
};

ImageInfo image_file_info(const std::filesystem::path& path);

// Throws Error(data) if the first bytes of a file are those of a known format that is not supported, such as
// AVIF, HEIC or GIF. The message contains the name of the format.
void refuse_unread_format(std::string_view head, const std::string& name);

// Returns the orientation of a TIFF file, and sets it to 1 in the bytes of the file. Returns 1 for other
// files.
int replace_tiff_orientation(std::span<unsigned char> file);

// Decodes the file to get its properties; used for formats whose header is not read here.
ImageInfo decoded_info(const std::filesystem::path& path);

}  // namespace ubs
