// SPDX-License-Identifier: Apache-2.0
// See png_pixels.hpp.
#include "host/dataset/png_pixels.hpp"

#include <png.h>

#include <algorithm>
#include <array>
#include <csetjmp>
#include <cstdio>
#include <cstring>

#include "host/base/error.hpp"
#include "host/dataset/image.hpp"
#include "host/dataset/stated_image.hpp"

namespace ubs {
namespace {

// Maximum number of pixels per byte of a file. It is checked because memory for all pixels is allocated
// before they are decoded. Deflate expands one byte to at most 1032 bytes, and a byte holds at most eight
// pixels of one bit.
constexpr std::size_t kMaxPngPixelsPerByte = std::size_t{8} * 1032;
constexpr unsigned kMaxAcross = 1u << 20;  // maximum width and height; OpenCV has the same limit

// Source contains the data that libpng's callbacks use. No member has a destructor, because errors leave the
// functions with longjmp(), which does not call destructors.
struct Source {
  std::jmp_buf back;
  char message[256];
  std::span<const std::byte> rest;
};

[[noreturn]] void leave(png_structp png, const char* message) {
  auto* source = static_cast<Source*>(png_get_error_ptr(png));
  std::snprintf(source->message, sizeof source->message, "%s", message);
  std::longjmp(source->back, 1);
}

// Ignores warnings, for example about unusual colour profiles, as other programs do.
void ignore(png_structp, const char*) {}

void read(png_structp png, png_bytep to, std::size_t size) {
  auto* source = static_cast<Source*>(png_get_io_ptr(png));
  if (size > source->rest.size()) leave(png, "the file ends too early");
  std::memcpy(to, source->rest.data(), size);
  source->rest = source->rest.subspan(size);
}

// Decodes the file into `pixels`. Returns false after an error, and stores its message in `source`.
bool decode(png_structp png, png_infop info, Source& source, std::size_t file_bytes, const std::string& name,
            cv::Mat& pixels) {
  if (setjmp(source.back)) return false;
  png_set_read_fn(png, &source, read);
  // A wrong checksum is an error in ancillary chunks too, because one of them, tRNS, changes pixels.
  png_set_crc_action(png, PNG_CRC_ERROR_QUIT, PNG_CRC_ERROR_QUIT);
  png_set_user_limits(png, kMaxAcross, kMaxAcross);
  png_read_info(png, info);
  const std::size_t width = png_get_image_width(png, info), height = png_get_image_height(png, info);
  if (width * height / kMaxPngPixelsPerByte > file_bytes) {
    std::snprintf(source.message, sizeof source.message, "%zu x %zu pixels cannot be stored in %zu bytes",
                  width, height, file_bytes);
    return false;
  }
  png_set_expand(png);  // expands palettes, samples with fewer than 8 bits, and transparent colours
  png_set_bgr(png);
  if (const int type = png_get_color_type(png, info);
      (type & PNG_COLOR_MASK_COLOR) == 0 &&
      ((type & PNG_COLOR_MASK_ALPHA) != 0 || png_get_valid(png, info, PNG_INFO_tRNS) != 0))
    png_set_gray_to_rgb(png);
  png_set_swap(png);
  const int passes = png_set_interlace_handling(png);
  png_read_update_info(png, info);
  require_image_memory(width, height,
                       std::uint64_t{png_get_channels(png, info)} * png_get_bit_depth(png, info) / 8, name);
  pixels.create(
      static_cast<int>(height), static_cast<int>(width),
      CV_MAKETYPE(png_get_bit_depth(png, info) == 16 ? CV_16U : CV_8U, png_get_channels(png, info)));
  for (int pass = 0; pass < passes; ++pass)
    for (int y = 0; y < pixels.rows; ++y) png_read_row(png, pixels.ptr(y), nullptr);
  png_read_end(png, nullptr);
  return true;
}

}  // namespace

bool is_png(std::span<const std::byte> file) {
  constexpr std::array kSignature{std::byte{0x89}, std::byte{'P'}, std::byte{'N'}, std::byte{'G'}};
  return file.size() > kSignature.size() && std::equal(kSignature.begin(), kSignature.end(), file.begin());
}

cv::Mat decode_png(std::span<const std::byte> file, const std::string& name) {
  Source source{{}, {}, file};
  struct Decoder {
    png_structp png = nullptr;
    png_infop info = nullptr;
    ~Decoder() { png_destroy_read_struct(&png, &info, nullptr); }
  } decoder;
  decoder.png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &source, leave, ignore);
  if (decoder.png != nullptr) decoder.info = png_create_info_struct(decoder.png);
  if (decoder.info == nullptr) fail(ErrorKind::memory, "{}: not enough memory to decode the image", name);
  cv::Mat pixels;
  if (!decode(decoder.png, decoder.info, source, file.size(), name, pixels))
    fail(ErrorKind::data, "{}: damaged or truncated PNG: {}", name, source.message);
  return pixels;
}

}  // namespace ubs
