// SPDX-License-Identifier: Apache-2.0
// The door to the image library: decoding files and encoding PNG. Built with UBS_OPENCV=OFF nothing can be
// decoded, and PNG are written without compression.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

namespace ubs {

// Interleaved samples: grey, RGB or RGBA (1, 3 or 4 channels), of 8 or 16 bits in the byte order of this
// machine.
struct RawImage {
  int width = 0, height = 0, channels = 0;
  bool wide = false;  // 16 bits
  std::vector<std::uint8_t> bytes;

  template <typename Sample>
  const Sample* samples() const {
    return reinterpret_cast<const Sample*>(bytes.data());
  }
  template <typename Sample>
  Sample* samples() {
    return reinterpret_cast<Sample*>(bytes.data());
  }
};

// Throws Error(data) naming the path. Orientation tags are ignored, as in the published loader (Pillow's
// Image.open).
RawImage decode_image(const std::filesystem::path& path);

void write_png(const std::filesystem::path& path, const RawImage& image);

}  // namespace ubs
