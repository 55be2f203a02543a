// SPDX-License-Identifier: Apache-2.0
// PNG files, decoded by libpng with its messages in our errors: through OpenCV it prints them on stderr
// beside ours.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace ubs {

bool is_png(std::span<const std::byte> file);

struct PngPixels {
  int width = 0, height = 0;
  int channels = 0;                   // 1: grey; 3: B, G, R; 4: B, G, R, alpha, also of grey with alpha
  int bytes = 1;                      // a sample; 2: as this machine has them
  std::vector<std::uint8_t> samples;  // rows without padding, channels together
};

// The stored values: no gamma or colour profile is applied. Throws Error(data) that starts with `name` for
// whatever libpng finds wrong, checksums of all chunks too, and for sizes that no file of this length can
// hold.
PngPixels decode_png(std::span<const std::byte> file, const std::string& name);

}  // namespace ubs
