// SPDX-License-Identifier: Apache-2.0
// Writing of PNG files, by zlib alone: builds without OpenCV have no libpng.
#pragma once

#include <cstddef>
#include <filesystem>
#include <vector>

#include "host/base/file.hpp"

namespace ubs {

struct PngForm {
  int width = 0, height = 0;
  int channels = 3;  // 1: grey, 3: RGB, 4: RGBA with straight alpha
  int bytes = 1;     // a sample
};

// A file's content. samples: rows without padding, channels together; 16-bit ones as this machine has them.
std::vector<std::byte> encode_png(const PngForm& form, const void* samples);
// Atomically.
void write_png(const std::filesystem::path& path, const PngForm& form, const void* samples,
               FileUse use = FileUse::result);

}  // namespace ubs
