// SPDX-License-Identifier: Apache-2.0
// JPEG files, decoded by libjpeg with its warnings as errors: OpenCV passes over them, and a file that is cut
// off or damaged then gives a picture that is grey or shifted from some row on, without a word.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace ubs {

bool is_jpeg(std::span<const std::byte> file);

struct JpegPixels {
  int width = 0, height = 0, channels = 0;  // 1: grey; 3: B, G, R
  std::vector<std::uint8_t> samples;        // rows without padding, channels together
};

// The stored pixels; the orientation tag is not applied. Nothing for files of four components (CMYK), which
// are decoded all the same, so that damage is found. Throws Error(data) that starts with `name` for whatever
// libjpeg finds wrong, and for sizes that no file of this length can hold.
std::optional<JpegPixels> decode_jpeg(std::span<const std::byte> file, const std::string& name);

}  // namespace ubs
