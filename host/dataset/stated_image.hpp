// SPDX-License-Identifier: Apache-2.0
// stated_image() reads the size of an image from the header of a file that OpenCV decodes. OpenCV allocates
// memory for all pixels before it decodes the first one, and a file of a few bytes can state any size.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

namespace ubs {

struct StatedImage {
  std::uint64_t width = 0, height = 0;
};

// Reads BMP and WebP. Throws Error(data) for all other formats, which are not supported, and
// for files that state no size.
StatedImage stated_image(std::span<const std::byte> file, const std::string& name);

// Throws Error(data) if an image has more pixels than ubs decodes, and Error(memory) if there is not enough
// memory for its decoded pixels and for the copy of them with 3 bytes per pixel that the loaders make. Must
// be called before the memory is allocated.
void require_image_memory(std::uint64_t width, std::uint64_t height, std::uint64_t pixel_bytes,
                          const std::string& name);

}  // namespace ubs
