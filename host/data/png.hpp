// SPDX-License-Identifier: Apache-2.0
// Writing of PNG files: by libpng (png_pixels.cpp), or in a build without OpenCV (image_without_opencv.cpp) by zlib
// alone.
#pragma once

#include <filesystem>

#include "host/base/file.hpp"

namespace ubs {

struct PngForm {
  int width = 0, height = 0;
  int channels = 3;  // 1: grey, 3: RGB, 4: RGBA with straight alpha
  int bytes = 1;     // a sample
};

// samples: rows without padding, channels together; 16-bit ones as this machine has them. Atomically.
void write_png(const std::filesystem::path& path, const PngForm& form, const void* samples,
               FileUse use = FileUse::result);

}  // namespace ubs
