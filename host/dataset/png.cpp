// SPDX-License-Identifier: Apache-2.0
// See png.hpp. The filter and the compression are those that OpenCV uses; they are fast and suit rendered
// images.
#include "host/dataset/png.hpp"

#include <cstdint>
#include <span>
#include <vector>

#include "host/base/crc32.hpp"
#include "host/formats/foreign_formats.hpp"

namespace ubs {
namespace {

void put32(std::vector<std::byte>& to, std::uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) to.push_back(static_cast<std::byte>(value >> shift));
}

void put_chunk(std::vector<std::byte>& to, const char (&name)[5], const std::vector<std::byte>& content) {
  put32(to, static_cast<std::uint32_t>(content.size()));
  const std::size_t checked = to.size();
  for (int i = 0; i < 4; ++i) to.push_back(static_cast<std::byte>(name[i]));
  to.insert(to.end(), content.begin(), content.end());
  put32(to, crc32(std::span(to).subspan(checked)));
}

// Encodes rows with PNG filter 1 (Sub): each row starts with the byte 1, followed by the difference of each
// pixel from the pixel on its left. Samples are big-endian.
std::vector<std::byte> png_rows(const PngForm& form, const void* samples) {
  const auto bytes = static_cast<std::size_t>(form.bytes), height = static_cast<std::size_t>(form.height);
  const std::size_t pixel = bytes * static_cast<std::size_t>(form.channels);
  const std::size_t row = pixel * static_cast<std::size_t>(form.width);
  const auto* in = static_cast<const std::uint8_t*>(samples);
  std::vector<std::byte> rows(height * (row + 1));
  std::byte* out = rows.data();
  for (std::size_t y = 0; y < height; ++y, in += row) {
    *out++ = std::byte{1};
    for (std::size_t i = 0; i < row; ++i) {
      const std::size_t at = i ^ (bytes - 1);
      *out++ = static_cast<std::byte>(in[at] - (i < pixel ? 0 : in[at - pixel]));
    }
  }
  return rows;
}

}  // namespace

std::vector<std::byte> encode_png(const PngForm& form, const void* samples) {
  // Colour types of PNG, indexed by the number of channels (1: grey, 3: RGB, 4: RGBA).
  constexpr int kColourTypes[] = {0, 0, 0, 2, 6};
  std::vector<std::byte> header;
  put32(header, static_cast<std::uint32_t>(form.width));
  put32(header, static_cast<std::uint32_t>(form.height));
  for (const int value : {8 * form.bytes, kColourTypes[form.channels], 0, 0, 0})
    header.push_back(static_cast<std::byte>(value));
  constexpr unsigned char kSignature[] = {0x89, 'P', 'N', 'G', 0x0d, 0x0a, 0x1a, 0x0a};
  std::vector<std::byte> file;
  for (const unsigned char value : kSignature) file.push_back(std::byte{value});
  put_chunk(file, "IHDR", header);
  put_chunk(file, "IDAT", deflate_runs(png_rows(form, samples)));
  put_chunk(file, "IEND", {});
  return file;
}

void write_png(const std::filesystem::path& path, const PngForm& form, const void* samples, FileUse use) {
  write_file_atomically(path, encode_png(form, samples), use);
}

}  // namespace ubs
