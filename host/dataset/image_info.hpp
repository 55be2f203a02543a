// SPDX-License-Identifier: Apache-2.0
// ImageInfo holds properties of an image file that are known before decoding: size, orientation tag and
// opacity. For PNG and JPEG only the header is read, so that opening thousands of files is fast; other
// formats are decoded.
#pragma once

#include <filesystem>
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

// Throws Error(data) if the first bytes of a file are not those of a supported format. If they are those of
// another known format, such as AVIF, HEIC or GIF, the message contains its name. OpenCV would also decode
// formats that ubs does not support. For some of them, such as Radiance HDR, a header of a few bytes makes it
// allocate gigabytes.
void refuse_unread_format(std::string_view head, const std::string& name);

// Decodes the file to get its properties; used for formats whose header is not read here.
ImageInfo decoded_info(const std::filesystem::path& path);

}  // namespace ubs
