// SPDX-License-Identifier: Apache-2.0
// Without an image library: nothing is decoded; PNG are written with stored (uncompressed) deflate blocks
// (RFC 1950, 1951 and the PNG specification, section 10).
#include <array>
#include <bit>
#include <string_view>

#include "host/base/crc32.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/data/image_codec.hpp"

namespace ubs {
namespace {

using Bytes = std::vector<std::uint8_t>;

void put32(Bytes& to, std::uint32_t value) {
  for (const int shift : {24, 16, 8, 0}) to.push_back(static_cast<std::uint8_t>(value >> shift));
}

std::uint32_t adler32(const Bytes& bytes) {
  std::uint32_t a = 1, b = 0;
  for (const std::uint8_t byte : bytes) {
    a = (a + byte) % 65521;
    b = (b + a) % 65521;
  }
  return b << 16 | a;
}

void put_chunk(Bytes& png, std::string_view type, const Bytes& data) {
  put32(png, static_cast<std::uint32_t>(data.size()));
  const std::size_t start = png.size();
  png.insert(png.end(), type.begin(), type.end());
  png.insert(png.end(), data.begin(), data.end());
  put32(png, crc32(std::as_bytes(std::span(png).subspan(start))));
}

// Rows with filter 0 in front; 16-bit samples in network order.
Bytes scanlines(const RawImage& image) {
  const std::size_t row =
      static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.channels) * (image.wide ? 2 : 1);
  Bytes lines;
  for (std::size_t y = 0; y < static_cast<std::size_t>(image.height); ++y) {
    lines.push_back(0);
    for (std::size_t i = 0; i < row; ++i) {
      const bool swap = image.wide && std::endian::native == std::endian::little;
      lines.push_back(image.bytes[y * row + (swap ? i ^ 1 : i)]);
    }
  }
  return lines;
}

Bytes zlib_stored(const Bytes& data) {
  constexpr std::size_t kMost = 65535;
  Bytes out{0x78, 0x01};
  std::size_t at = 0;
  do {
    const std::size_t size = std::min(kMost, data.size() - at);
    const auto length = static_cast<std::uint16_t>(size), inverse = static_cast<std::uint16_t>(~size);
    out.push_back(at + size == data.size() ? 1 : 0);  // last block
    for (const std::uint16_t value : {length, inverse}) {
      out.push_back(static_cast<std::uint8_t>(value & 0xff));
      out.push_back(static_cast<std::uint8_t>(value >> 8));
    }
    out.insert(out.end(), data.begin() + static_cast<std::ptrdiff_t>(at),
               data.begin() + static_cast<std::ptrdiff_t>(at + size));
    at += size;
  } while (at < data.size());
  put32(out, adler32(data));
  return out;
}

}  // namespace

RawImage decode_image(const std::filesystem::path& path) {
  fail(ErrorKind::data,
       "{}: this build cannot read image files (UBS_OPENCV=OFF); pack the data set where they can be read: "
       "ubs pack DATA --out F.ubsd",
       path.string());
}

void write_png(const std::filesystem::path& path, const RawImage& image) {
  constexpr std::array<std::uint8_t, 5> kColourType{0, 0, 0, 2, 6};  // by channels: grey, -, RGB, RGBA
  Bytes png{0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'}, head;
  put32(head, static_cast<std::uint32_t>(image.width));
  put32(head, static_cast<std::uint32_t>(image.height));
  const auto bits = static_cast<std::uint8_t>(image.wide ? 16 : 8);
  head.insert(head.end(), {bits, kColourType[static_cast<std::size_t>(image.channels)], 0, 0, 0});
  put_chunk(png, "IHDR", head);
  put_chunk(png, "IDAT", zlib_stored(scanlines(image)));
  put_chunk(png, "IEND", {});
  write_file_atomically(path, std::as_bytes(std::span(png)));
}

}  // namespace ubs
