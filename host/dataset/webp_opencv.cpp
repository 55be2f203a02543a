// SPDX-License-Identifier: Apache-2.0
// See webp.hpp.
#include <cstring>
#include <opencv2/imgcodecs.hpp>

#include "host/base/byte_reader.hpp"
#include "host/base/error.hpp"
#include "host/base/memory_limit.hpp"
#include "host/dataset/opencv_parts.hpp"
#include "host/formats/webp.hpp"

namespace ubs {
namespace {

constexpr int kLosslessQuality = 101;    // OpenCV encodes without loss if the quality is above 100
constexpr std::size_t kPixelBytes = 12;  // memory per pixel for the decoder, for OpenCV and for the result

// Swaps R and B. OpenCV uses B, G, R, A, so the same swap converts in both directions.
void exchange_red_and_blue(std::span<std::uint8_t> rgba) {
  for (std::size_t i = 0; i + 3 < rgba.size(); i += 4) std::swap(rgba[i], rgba[i + 2]);
}

// Returns the number of pixels that the header of the file states. The file must be a plain lossless image,
// or an image with an extended header.
std::size_t stated_pixels(std::span<const std::byte> bytes, const std::string& name) {
  ByteReader in(bytes, name);
  const auto is = [&](const char* word) { return std::memcmp(in.take(4).data(), word, 4) == 0; };
  if (bytes.size() < 30 || !is("RIFF") || (in.skip(4), !is("WEBP")))
    fail(ErrorKind::data, "{}: not a WebP image", name);
  const auto kind = in.take(4);
  in.skip(4);
  std::size_t width = 0, height = 0;
  if (std::memcmp(kind.data(), "VP8L", 4) == 0) {
    in.skip(1);
    const auto bits = in.read<std::uint32_t>();
    width = bits % 16384 + 1, height = bits / 16384 % 16384 + 1;
  } else if (std::memcmp(kind.data(), "VP8X", 4) == 0) {
    in.skip(4);
    const auto number = [&] {
      const std::size_t low = in.read<std::uint16_t>();
      return low | std::size_t{in.read<std::uint8_t>()} << 16;
    };
    width = number() + 1;
    height = number() + 1;
  } else {
    fail(ErrorKind::data, "{}: this WebP image is lossy, but its pixels encode data and must be lossless",
         name);
  }
  return width * height;
}

}  // namespace

std::vector<std::byte> encode_webp(const Rgba8& image) {
  std::vector<std::uint8_t> bgra = image.rgba;
  exchange_red_and_blue(bgra);
  std::vector<unsigned char> bytes;
  try {
    if (!opencv().imencode(".webp", cv::Mat(image.height, image.width, CV_8UC4, bgra.data()), bytes,
                           {cv::IMWRITE_WEBP_QUALITY, kLosslessQuality}))
      fail(ErrorKind::internal, "the WebP encoder failed");
  } catch (const cv::Exception& error) {
    fail(ErrorKind::internal, "the WebP encoder failed: {}", error.err);
  }
  const auto as_bytes = std::as_bytes(std::span(bytes));
  return {as_bytes.begin(), as_bytes.end()};
}

Rgba8 decode_webp(std::span<const std::byte> bytes, std::size_t most_pixels, const std::string& name) {
  if (const std::size_t pixels = stated_pixels(bytes, name); pixels > most_pixels)
    fail(ErrorKind::data, "{}: {} pixels are too many: at most {} are expected", name, pixels, most_pixels);
  require_memory(kPixelBytes * stated_pixels(bytes, name), name);
  cv::Mat image;
  try {
    const cv::Mat encoded(1, static_cast<int>(bytes.size()), CV_8U, const_cast<std::byte*>(bytes.data()));
    image = opencv().imdecode(encoded, cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception& error) {
    fail(ErrorKind::data, "{}: cannot decode: {}", name, error.err);
  }
  if (image.empty() || image.depth() != CV_8U || (image.channels() != 3 && image.channels() != 4))
    fail(ErrorKind::data, "{}: the WebP image is damaged", name);
  Rgba8 out{image.cols, image.rows, {}};
  out.rgba.reserve(4 * image.total());
  const int channels = image.channels();
  for (int y = 0; y < image.rows; ++y)
    for (int x = 0; x < image.cols; ++x) {
      const std::uint8_t* p = image.ptr<std::uint8_t>(y) + channels * x;
      for (const std::uint8_t v : {p[2], p[1], p[0], channels == 4 ? p[3] : std::uint8_t{255}})
        out.rgba.push_back(v);
    }
  return out;
}

}  // namespace ubs
