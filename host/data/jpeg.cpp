// SPDX-License-Identifier: Apache-2.0
// See jpeg.hpp.
#include "host/data/jpeg.hpp"

#include <cstdio>
// libjpeg's headers need FILE from the line above.
#include <jerror.h>
#include <jpeglib.h>

#include <csetjmp>

#include "host/base/error.hpp"
#include "host/data/image.hpp"

namespace ubs {
namespace {

// A block of 64 samples takes one bit at least, and the most reduced chroma leaves 18 blocks for 1024 pixels:
// no Huffman code gets beyond 456 pixels a byte. Libjpeg allocates before it decodes.
constexpr std::size_t kMaxJpegPixelsPerByte = 1000;

struct Failure {
  jpeg_error_mgr manager;  // first: libjpeg knows its address only
  std::jmp_buf back;
  char message[JMSG_LENGTH_MAX];
};

[[noreturn]] void leave(j_common_ptr info) {
  auto* failure = reinterpret_cast<Failure*>(info->err);
  info->err->format_message(info, failure->message);
  std::longjmp(failure->back, 1);
}

// Levels from 0 are traces. Marks of versions and colour transforms of other programs do no harm.
void warn(j_common_ptr info, int level) {
  const int code = info->err->msg_code;
  if (level < 0 && code != JWRN_JFIF_MAJOR && code != JWRN_ADOBE_XFORM) leave(info);
}

void silent(j_common_ptr) {}

// What libjpeg fills; nothing here has a destructor, because errors jump over them.
struct Decoder {
  jpeg_decompress_struct info;
  Failure failure;
};

// Decodes all rows into `pixels`, reporting through the jump in `decoder.failure`. False after an error.
bool decode(Decoder& decoder, std::span<const std::byte> file, const std::string& name, JpegPixels& pixels,
            std::vector<std::uint8_t>& row) {
  jpeg_decompress_struct& info = decoder.info;
  info.err = jpeg_std_error(&decoder.failure.manager);
  info.err->error_exit = leave;
  info.err->emit_message = warn;
  info.err->output_message = silent;
  if (setjmp(decoder.failure.back)) return false;
  jpeg_create_decompress(&info);
  jpeg_mem_src(&info, reinterpret_cast<const unsigned char*>(file.data()), file.size());
  jpeg_read_header(&info, TRUE);
  const std::size_t count = std::size_t{info.image_width} * info.image_height;
  if (count / kMaxJpegPixelsPerByte > file.size()) {
    std::snprintf(decoder.failure.message, sizeof decoder.failure.message, "%u x %u pixels in %zu bytes",
                  info.image_width, info.image_height, file.size());
    return false;
  }
  if (count > kMaxDecodedPixels)
    fail(ErrorKind::data, "{}: {} x {} pixels; images have at most {}", name, info.image_width,
         info.image_height, kMaxDecodedPixels);
  const bool cmyk = info.num_components == 4;
  info.out_color_space = cmyk ? JCS_CMYK : info.num_components == 1 ? JCS_GRAYSCALE : JCS_EXT_BGR;
  jpeg_start_decompress(&info);
  const std::size_t row_bytes = std::size_t{info.output_width} * info.output_components;
  pixels.width = static_cast<int>(info.output_width);
  pixels.height = static_cast<int>(info.output_height);
  pixels.channels = info.output_components;
  if (cmyk)
    row.resize(row_bytes);
  else
    pixels.samples.resize(row_bytes * info.output_height);
  while (info.output_scanline < info.output_height) {
    JSAMPROW at = cmyk ? row.data() : pixels.samples.data() + row_bytes * info.output_scanline;
    jpeg_read_scanlines(&info, &at, 1);
  }
  jpeg_finish_decompress(&info);  // as far as the end mark
  return true;
}

}  // namespace

bool is_jpeg(std::span<const std::byte> file) {
  return file.size() > 2 && file[0] == std::byte{0xff} && file[1] == std::byte{0xd8} &&
         file[2] == std::byte{0xff};
}

std::optional<JpegPixels> decode_jpeg(std::span<const std::byte> file, const std::string& name) {
  Decoder decoder{};
  struct Destroyer {
    jpeg_decompress_struct& info;
    ~Destroyer() { jpeg_destroy_decompress(&info); }
  } const destroyer{decoder.info};
  JpegPixels pixels;
  std::vector<std::uint8_t> row;
  if (!decode(decoder, file, name, pixels, row))
    fail(ErrorKind::data, "{}: damaged or cut off JPEG: {}", name, decoder.failure.message);
  if (pixels.channels == 4) return std::nullopt;
  return pixels;
}

}  // namespace ubs
