// SPDX-License-Identifier: Apache-2.0
#include "host/dataset/stated_image.hpp"

#include <cstdlib>
#include <cstring>
#include <string_view>

#include "host/base/error.hpp"
#include "host/base/memory_limit.hpp"
#include "host/dataset/image.hpp"

namespace ubs {
namespace {

using ImageFile = std::span<const std::byte>;

bool header_has(ImageFile file, std::size_t at, std::string_view word) {
  return at + word.size() <= file.size() && std::memcmp(file.data() + at, word.data(), word.size()) == 0;
}

// Returns an unsigned number of 1 to 8 bytes (little-endian), or 0 if it is not inside the file.
std::uint64_t header_number(ImageFile file, std::uint64_t at, std::uint64_t bytes) {
  if (at > file.size() || bytes > file.size() - at) return 0;
  std::uint64_t value = 0;
  for (std::uint64_t i = 0; i < bytes; ++i) value |= static_cast<std::uint64_t>(file[at + i]) << 8 * i;
  return value;
}

// The height is negative if the first row is the top row.
StatedImage stated_bmp(ImageFile file) {
  if (header_number(file, 14, 4) == 12) return {header_number(file, 18, 2), header_number(file, 20, 2)};
  const auto height = static_cast<std::int32_t>(header_number(file, 22, 4));
  return {header_number(file, 18, 4), static_cast<std::uint64_t>(std::abs(std::int64_t{height}))};
}

StatedImage stated_webp(ImageFile file) {
  if (header_has(file, 12, "VP8X")) return {header_number(file, 24, 3) + 1, header_number(file, 27, 3) + 1};
  if (header_has(file, 12, "VP8L")) {
    const std::uint64_t bits = header_number(file, 21, 4);
    return {bits % 16384 + 1, bits / 16384 % 16384 + 1};
  }
  return {header_number(file, 26, 2) % 16384, header_number(file, 28, 2) % 16384};  // VP8
}

}  // namespace

StatedImage stated_image(ImageFile file, const std::string& name) {
  StatedImage image;
  if (header_has(file, 0, "BM"))
    image = stated_bmp(file);
  else if (header_has(file, 0, "RIFF") && header_has(file, 8, "WEBP"))
    image = stated_webp(file);
  else
    fail(ErrorKind::data, "{}: cannot decode: unknown format or damaged file: convert to JPEG or PNG", name);
  if (image.width == 0 || image.height == 0)
    fail(ErrorKind::data, "{}: cannot decode: the header is damaged and states no size", name);
  return image;
}

void require_image_memory(std::uint64_t width, std::uint64_t height, std::uint64_t pixel_bytes,
                          const std::string& name) {
  constexpr std::uint64_t kSmall = std::uint64_t{64} << 20;  // not worth asking
  if (height > kMaxDecodedPixels / width)
    fail(ErrorKind::data, "{}: {} x {} pixels are too many: images can have at most {}", name, width, height,
         kMaxDecodedPixels);
  if (const std::uint64_t need = width * height * (pixel_bytes + 3); need > kSmall)
    require_memory(need, fmt::format("{}: an image of {} x {} pixels", name, width, height));
}

}  // namespace ubs
