// SPDX-License-Identifier: Apache-2.0
// See image_info.hpp. A JPEG file is a chain of segments. A segment consists of two bytes FF xx, its length
// (2 bytes, big-endian, which includes these two bytes) and its body. The segments SOFn contain the image
// size, and the segment APP1 "Exif" contains a TIFF directory with the orientation.
#include "host/dataset/image_info.hpp"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <string_view>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/file.hpp"

namespace ubs {

namespace {

int big16(const unsigned char* at) { return at[0] << 8 | at[1]; }
std::uint32_t big32(const unsigned char* at) {
  return static_cast<std::uint32_t>(big16(at)) << 16 | static_cast<std::uint32_t>(big16(at + 2));
}

// Returns the number that is stored in `bytes` (2 or 4) bytes at `offset` of a TIFF block. Returns 0 if these
// bytes are not inside the block.
std::uint32_t tiff_number(std::span<const unsigned char> tiff, std::size_t offset, int bytes, bool big) {
  if (offset + static_cast<std::size_t>(bytes) > tiff.size()) return 0;
  std::uint32_t value = 0;
  for (int i = 0; i < bytes; ++i)
    value |= static_cast<std::uint32_t>(tiff[offset + static_cast<std::size_t>(i)])
             << 8 * (big ? bytes - 1 - i : i);
  return value;
}

// Returns the offset of the orientation in the first directory of a TIFF block, or 0 if there is none. The
// orientation is a number of two bytes.
std::size_t orientation_offset(std::span<const unsigned char> tiff) {
  const bool big = tiff[0] == 'M';
  const std::size_t directory = tiff_number(tiff, 4, 4, big);
  const std::size_t entries = tiff_number(tiff, directory, 2, big);
  for (std::size_t e = 0; e < entries; ++e) {
    const std::size_t entry = directory + 2 + 12 * e;
    if (entry + 12 > tiff.size()) break;
    if (tiff_number(tiff, entry, 2, big) == 0x0112) return entry + 8;
  }
  return 0;
}

int orientation_at(std::span<const unsigned char> tiff, std::size_t offset) {
  const auto value = offset == 0 ? 1 : static_cast<int>(tiff_number(tiff, offset, 2, tiff[0] == 'M'));
  return value >= 1 && value <= 8 ? value : 1;
}

int exif_orientation(std::span<const unsigned char> segment) {
  if (segment.size() < 14 || std::memcmp(segment.data(), "Exif\0", 6) != 0) return 1;
  const std::span<const unsigned char> tiff = segment.subspan(6);
  return orientation_at(tiff, orientation_offset(tiff));
}

// Reads the size and the orientation of a JPEG file. Returns false if the file is not a JPEG, or if its chain
// of segments is damaged before a size is found.
bool jpeg_info(std::ifstream& stream, ImageInfo& info) {
  unsigned char head[4] = {};
  stream.read(reinterpret_cast<char*>(head), 2);
  if (!stream || head[0] != 0xff || head[1] != 0xd8) return false;
  while (stream.read(reinterpret_cast<char*>(head), 4)) {
    if (head[0] != 0xff) return false;
    const int marker = head[1], length = big16(head + 2) - 2;
    if (length < 0) return false;
    std::vector<unsigned char> body(static_cast<std::size_t>(length));
    if (!stream.read(reinterpret_cast<char*>(body.data()), length)) return false;
    if (marker == 0xe1 && info.orientation == 1) info.orientation = exif_orientation(body);
    const bool frame = marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    if (!frame) continue;
    if (length < 5) return false;
    info.size = {big16(body.data() + 3), big16(body.data() + 1)};
    info.opaque = true;
    return info.size.width > 0 && info.size.height > 0;
  }
  return false;
}

// Returns whether a PNG file has a chunk tRNS before its pixels. This chunk makes one or several colours
// transparent.
bool png_has_clear_colour(std::ifstream& stream) {
  constexpr std::streamoff kSignature = 8, kChecksum = 4;
  unsigned char head[8] = {};
  stream.seekg(kSignature);
  while (stream.read(reinterpret_cast<char*>(head), sizeof head)) {
    if (std::memcmp(head + 4, "tRNS", 4) == 0) return true;
    if (std::memcmp(head + 4, "IDAT", 4) == 0) return false;
    stream.seekg(static_cast<std::streamoff>(big32(head)) + kChecksum, std::ios::cur);
  }
  return false;
}

bool png_info(std::ifstream& stream, const std::string& name, ImageInfo& info) {
  unsigned char head[26] = {};
  stream.read(reinterpret_cast<char*>(head), sizeof head);
  constexpr unsigned char kPng[] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  if (!stream || std::memcmp(head, kPng, sizeof kPng) != 0 || std::memcmp(head + 12, "IHDR", 4) != 0)
    return false;
  info.size = {big16(head + 16) << 16 | big16(head + 18), big16(head + 20) << 16 | big16(head + 22)};
  if (info.size.width < 1 || info.size.height < 1) fail(ErrorKind::data, "{}: damaged PNG header", name);
  const int colour_type = head[25];  // types 4 and 6 have alpha
  info.opaque = colour_type < 4 && !png_has_clear_colour(stream);
  return true;
}

// ImageFormat describes a common image format that ubs cannot decode. It is recognised by `bytes`, which are
// at the offset `at` of the file.
struct ImageFormat {
  std::size_t at;
  std::string_view bytes;
  const char* name;
};
constexpr ImageFormat kUnread[] = {
    {4, "ftypavif", "AVIF"},    {4, "ftypavis", "AVIF"},      {4, "ftypheic", "HEIC"},
    {4, "ftypheix", "HEIC"},    {4, "ftypmif1", "HEIF"},      {4, "ftypmsf1", "HEIF"},
    {4, "ftyphevc", "HEIC"},    {0, "GIF8", "GIF"},           {4, "JXL ", "JPEG XL"},
    {0, "\xff\x0a", "JPEG XL"}, {4, "ftypcrx ", "Canon CR3"}, {0, "8BPS", "PSD"},
};

constexpr ImageFormat kReadFormats[] = {
    {0, "\x89PNG", "PNG"},
    {0, "\xff\xd8", "JPEG"},
    {8, "WEBP", "WebP"},
    {0, "BM", "BMP"},
    {0, "\x76\x2f\x31\x01", "EXR"},
    {0, std::string_view("II*\0", 4), "TIFF"},
    {0, std::string_view("MM\0*", 4), "TIFF"},
    {0, std::string_view("II+\0", 4), "TIFF"},
    {0, std::string_view("MM\0+", 4), "TIFF"},
};

bool starts_as(std::string_view head, const ImageFormat& format) {
  return head.size() >= format.at + format.bytes.size() &&
         head.substr(format.at, format.bytes.size()) == format.bytes;
}

}  // namespace

void refuse_unread_format(std::string_view head, const std::string& name) {
  for (const ImageFormat& format : kUnread)
    if (starts_as(head, format))
      fail(ErrorKind::data, "{}: format {} is not supported: convert to JPEG or PNG", name, format.name);
  if (std::ranges::none_of(kReadFormats, [&](const ImageFormat& format) { return starts_as(head, format); }))
    fail(ErrorKind::data, "{}: cannot decode: unknown format or damaged file", name);
}

ImageInfo image_file_info(const std::filesystem::path& path) {
  std::size_t bytes = 0;
  std::ifstream stream = open_for_reading(path, bytes);
  ImageInfo info;
  if (png_info(stream, path.string(), info)) return info;
  stream.clear();
  stream.seekg(0);
  if (jpeg_info(stream, info)) return info;
  stream.clear();
  stream.seekg(0);
  std::string head(16, '\0');
  stream.read(head.data(), static_cast<std::streamsize>(head.size()));
  refuse_unread_format(std::string_view(head).substr(0, static_cast<std::size_t>(stream.gcount())),
                       path.string());
  return decoded_info(path);
}

ImageSize image_file_size(const std::filesystem::path& path) { return image_file_info(path).size; }

}  // namespace ubs
