// SPDX-License-Identifier: Apache-2.0
#include "host/dataset/stated_image.hpp"

#include <algorithm>
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

// Returns an unsigned number of 1 to 8 bytes, or 0 if it is not inside the file.
std::uint64_t header_number(ImageFile file, std::uint64_t at, std::uint64_t bytes, bool big = false) {
  if (at > file.size() || bytes > file.size() - at) return 0;
  std::uint64_t value = 0;
  for (std::uint64_t i = 0; i < bytes; ++i)
    value |= static_cast<std::uint64_t>(file[at + i]) << 8 * (big ? bytes - 1 - i : i);
  return value;
}

// Reads the tags ImageWidth, ImageLength and BitsPerSample of the first directory. BigTIFF has larger numbers
// and entries. A decoded image has at most four channels.
StatedImage stated_tiff(ImageFile file) {
  const bool big = header_has(file, 0, "M"), wide = header_number(file, 2, 2, big) == 43;
  const std::uint64_t directory = wide ? header_number(file, 8, 8, big) : header_number(file, 4, 4, big);
  const std::uint64_t count_bytes = wide ? 8 : 2, entry_bytes = wide ? 20 : 12;
  const std::uint64_t entries =
      std::min<std::uint64_t>(header_number(file, directory, count_bytes, big), file.size() / entry_bytes);
  StatedImage image;
  for (std::uint64_t i = 0; i < entries; ++i) {
    const std::uint64_t entry = directory + count_bytes + i * entry_bytes;
    const std::uint64_t tag = header_number(file, entry, 2, big),
                        type = header_number(file, entry + 2, 2, big);
    const std::uint64_t count = header_number(file, entry + 4, wide ? 8 : 4, big);
    const std::uint64_t place = entry + (wide ? 12 : 8), size = type == 3 ? 2 : type == 16 ? 8 : 4;
    // Several numbers that do not fit into the entry are elsewhere in the file.
    const bool elsewhere = count * size > (wide ? 8u : 4u);
    const std::uint64_t at = elsewhere ? header_number(file, place, wide ? 8 : 4, big) : place;
    const std::uint64_t value = header_number(file, at, size, big);
    if (tag == 256) image.width = value;
    if (tag == 257) image.height = value;
    if (tag == 258) image.pixel_bytes = value <= 8 ? 4 : value <= 16 ? 8 : value <= 32 ? 16 : 32;
  }
  return image;
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

// The header is a list of attributes: name, type, size of the value, value. Names and types end with a 0
// byte. The attribute dataWindow contains the first and last column and row.
StatedImage stated_exr(ImageFile file) {
  const std::string_view text(reinterpret_cast<const char*>(file.data()), file.size());
  for (std::size_t at = 8; at < text.size() && text[at] != 0;) {
    const std::size_t type = text.find('\0', at) + 1, size = text.find('\0', type) + 1;
    if (type == 0 || size == 0) break;
    if (text.substr(at, type - at - 1) == "dataWindow") {
      const auto corner = [&](std::size_t i) {
        return std::int64_t{static_cast<std::int32_t>(header_number(file, size + 4 + 4 * i, 4))};
      };
      const std::int64_t width = corner(2) - corner(0) + 1, height = corner(3) - corner(1) + 1;
      if (width < 1 || height < 1) break;
      return {static_cast<std::uint64_t>(width), static_cast<std::uint64_t>(height), 16};
    }
    at = size + 4 + header_number(file, size, 4);
  }
  return {};
}

}  // namespace

StatedImage stated_image(ImageFile file, const std::string& name) {
  StatedImage image;
  if (header_has(file, 0, "II") || header_has(file, 0, "MM"))
    image = stated_tiff(file);
  else if (header_has(file, 0, "BM"))
    image = stated_bmp(file);
  else if (header_has(file, 0, "RIFF") && header_has(file, 8, "WEBP"))
    image = stated_webp(file);
  else if (header_has(file, 0, "\x76\x2f\x31\x01"))
    image = stated_exr(file);
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
