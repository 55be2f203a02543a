// SPDX-License-Identifier: Apache-2.0
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/data/image_codec.hpp"

namespace ubs {
namespace {

// OpenCV keeps B, G, R(, A).
void swap_colours(cv::Mat& image) {
  if (image.channels() == 3) cv::cvtColor(image, image, cv::COLOR_BGR2RGB);
  if (image.channels() == 4) cv::cvtColor(image, image, cv::COLOR_BGRA2RGBA);
}

}  // namespace

RawImage decode_image(const std::filesystem::path& path) {
  const std::vector<std::byte> bytes = read_file(path);
  if (bytes.empty()) fail(ErrorKind::data, "{}: empty file", path.string());
  cv::Mat image;
  try {
    const cv::Mat encoded(1, static_cast<int>(bytes.size()), CV_8U, const_cast<std::byte*>(bytes.data()));
    image = cv::imdecode(encoded, cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception& error) {
    fail(ErrorKind::data, "{}: cannot decode: {}", path.string(), error.err);
  }
  if (image.empty())
    fail(ErrorKind::data, "{}: cannot decode: unknown format or damaged file", path.string());
  if (image.depth() != CV_8U && image.depth() != CV_16U)
    fail(ErrorKind::data, "{}: only 8- and 16-bit images are supported", path.string());
  if (image.channels() == 2 || image.channels() > 4)
    fail(ErrorKind::data, "{}: {} channels are not supported", path.string(), image.channels());
  swap_colours(image);
  RawImage raw{image.cols, image.rows, image.channels(), image.depth() == CV_16U, {}};
  for (int y = 0; y < image.rows; ++y)
    raw.bytes.insert(raw.bytes.end(), image.ptr(y),
                     image.ptr(y) + static_cast<std::size_t>(image.cols) * image.elemSize());
  return raw;
}

void write_png(const std::filesystem::path& path, const RawImage& image) {
  cv::Mat mat = cv::Mat(image.height, image.width, CV_MAKETYPE(image.wide ? CV_16U : CV_8U, image.channels),
                        const_cast<std::uint8_t*>(image.bytes.data()))
                    .clone();
  swap_colours(mat);
  std::vector<unsigned char> bytes;
  try {
    if (!cv::imencode(".png", mat, bytes)) fail(ErrorKind::internal, "{}: PNG encoder failed", path.string());
  } catch (const cv::Exception& error) {
    fail(ErrorKind::internal, "{}: PNG encoder failed: {}", path.string(), error.err);
  }
  write_file_atomically(path, std::as_bytes(std::span(bytes)));
}

}  // namespace ubs
