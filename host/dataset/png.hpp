// SPDX-License-Identifier: Apache-2.0
// encode_png() and write_png() write PNG files. They need only zlib, because builds without OpenCV have no
// libpng.
#pragma once

#include <cstddef>
#include <filesystem>
#include <vector>

#include "host/base/file.hpp"

namespace ubs {

struct PngForm {
  int width = 0, height = 0;
  int channels = 3;  // 1: grey, 3: RGB, 4: RGBA with straight alpha
  int bytes = 1;     // bytes per sample
};

// Returns the content of a PNG file. `samples` has rows without padding and interleaved channels; 16-bit
// samples are in native byte order.
std::vector<std::byte> encode_png(const PngForm& form, const void* samples);
// Writes the file atomically.
void write_png(const std::filesystem::path& path, const PngForm& form, const void* samples,
               FileUse use = FileUse::result);

}  // namespace ubs
