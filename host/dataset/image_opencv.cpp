// SPDX-License-Identifier: Apache-2.0
// This file has the functions of image.hpp and image_info.hpp that decode files. Each format has its own
// library; OpenCV decodes WebP, BMP and JPEG files with CMYK.
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <span>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/warning.hpp"
#include "host/dataset/exr.hpp"
#include "host/dataset/image.hpp"
#include "host/dataset/image_info.hpp"
#include "host/dataset/jpeg.hpp"
#include "host/dataset/opencv_parts.hpp"
#include "host/dataset/png_pixels.hpp"
#include "host/dataset/resample.hpp"
#include "host/dataset/stated_image.hpp"
#include "host/dataset/tiff.hpp"

namespace ubs {
namespace {

// PixelData holds decoded pixels: integers of 8 or 16 bits, or floats. There is one channel, or three (B, G,
// R), or four (B, G, R, A).
struct PixelData {
  cv::Mat pixels;
  // The colours are multiplied by alpha. Floats (EXR) always are.
  bool premultiplied = false;
  int orientation = 1;  // of a TIFF file
};

// Decodes an image file. Orientation tags are ignored, as in the loader of the published code (Pillow's
// Image.open), because the cameras of every data set describe the stored pixels.
PixelData decode_image_file(const std::filesystem::path& path) {
  const std::vector<std::byte> bytes = read_file(path);
  const std::string name = path.string();
  if (bytes.empty()) fail(ErrorKind::data, "{}: the image is an empty file", name);
  cv::Mat image;
  try {
    if (is_png(bytes)) return {decode_png(bytes, name)};
    if (is_exr(bytes)) return {decode_exr(bytes, name), true};
    if (is_tiff(bytes)) {
      TiffImage tiff = decode_tiff(bytes, name);
      return {std::move(tiff.pixels), tiff.premultiplied, tiff.orientation};
    }
    if (is_jpeg(bytes)) {
      image = decode_jpeg(bytes, name);
      if (!image.empty()) return {std::move(image)};
    } else {
      refuse_unread_format({reinterpret_cast<const char*>(bytes.data()), bytes.size()}, name);
      const StatedImage stated = stated_image(bytes, name);
      require_image_memory(stated.width, stated.height, 4, name);
    }
    const cv::Mat encoded(1, static_cast<int>(bytes.size()), CV_8U, const_cast<std::byte*>(bytes.data()));
    image = opencv().imdecode(encoded, cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception& error) {
    fail(error.code == cv::Error::StsNoMem ? ErrorKind::memory : ErrorKind::data, "{}: cannot decode: {}",
         name, error.err);
  }
  if (image.empty()) fail(ErrorKind::data, "{}: cannot decode: unknown format or damaged file", name);
  if (image.depth() != CV_8U || image.channels() == 2 || image.channels() > 4)
    fail(ErrorKind::data, "{}: only grey, RGB and RGBA images are supported", name);
  return {std::move(image)};
}

std::uint8_t to_8_bit(std::uint8_t v) { return v; }
std::uint8_t to_8_bit(std::uint16_t v) { return static_cast<std::uint8_t>((v + 128) / 257); }

// Composites an image on the background. OpenCV stores the channels in the order B, G, R, A. The computation
// uses double precision like the published code. In double precision, v / 255 * 255 truncates to v for every
// v from 0 to 255, so the colours of opaque pixels do not change.
template <typename Sample>
Image8 composite(const cv::Mat& image, bool premultiplied, const std::array<double, 3>& background) {
  constexpr double kMax = std::numeric_limits<Sample>::max();
  const int channels = image.channels();
  Image8 result{image.cols, image.rows, {}};
  result.rgb.resize(sample_count(image.cols, image.rows, 3));
  std::uint8_t* out = result.rgb.data();
  for (int y = 0; y < image.rows; ++y) {
    const Sample* in = image.ptr<Sample>(y);
    for (int x = 0; x < image.cols; ++x, in += channels)
      for (int c = 0; c < 3; ++c) {
        const Sample value = channels == 1 ? in[0] : in[2 - c];
        if (channels < 4) {
          *out++ = to_8_bit(value);
          continue;
        }
        const double alpha = in[3] / kMax;
        const double mixed = value / kMax * (premultiplied ? 1.0 : alpha) +
                             background[static_cast<std::size_t>(c)] * (1.0 - alpha);
        *out++ = static_cast<std::uint8_t>(std::clamp(mixed * 255.0, 0.0, 255.0));
      }
  }
  return result;
}

double srgb_from_linear(double v) {
  return v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1.0 / 2.4) - 0.055;
}

// Composites a float image (EXR) on the background. Its colours are linear light and premultiplied with
// alpha. They are divided by alpha, converted with the sRGB curve and then mixed with the background. So,
// except for rounding, the result equals that of the same image saved as PNG.
Image8 composite_linear(const cv::Mat& image, const std::array<double, 3>& background,
                        const std::string& name) {
  const int channels = image.channels();
  Image8 result{image.cols, image.rows, {}};
  result.rgb.reserve(sample_count(image.cols, image.rows, 3));
  for (int y = 0; y < image.rows; ++y) {
    const float* in = image.ptr<float>(y);
    for (int x = 0; x < image.cols; ++x, in += channels) {
      const double alpha = channels == 4 ? std::clamp(static_cast<double>(in[3]), 0.0, 1.0) : 1.0;
      for (int c = 0; c < 3; ++c) {
        const double value = channels == 1 ? in[0] : in[2 - c];
        if (!std::isfinite(value) || !std::isfinite(alpha))
          fail(ErrorKind::data, "{}: pixel ({}, {}) is not finite", name, x, y);
        const double straight = alpha > 0 ? std::clamp(value / alpha, 0.0, 1.0) : 0.0;
        const double mixed =
            srgb_from_linear(straight) * alpha + background[static_cast<std::size_t>(c)] * (1.0 - alpha);
        result.rgb.push_back(static_cast<std::uint8_t>(mixed * 255.0 + 0.5));
      }
    }
  }
  return result;
}

}  // namespace

Image8 load_image(const std::filesystem::path& path, const std::array<double, 3>& background) {
  const PixelData image = decode_image_file(path);
  if (image.pixels.depth() == CV_8U)
    return composite<std::uint8_t>(image.pixels, image.premultiplied, background);
  if (image.pixels.depth() == CV_16U)
    return composite<std::uint16_t>(image.pixels, image.premultiplied, background);
  return composite_linear(image.pixels, background, path.string());
}

Image8 load_mask_image(const std::filesystem::path& path, const Image8& image) {
  const cv::Mat mask = decode_image_file(path).pixels;
  if (mask.depth() == CV_32F) fail(ErrorKind::data, "{}: a mask must have 8 or 16 bits", path.string());
  // A mask that has another size than the image is accepted if the aspect ratios differ by at most 1 %,
  // because the mask may have been made for the full-size image.
  const double across = static_cast<double>(mask.cols) / image.width;
  if (std::abs(across - static_cast<double>(mask.rows) / image.height) > 0.01 * across)
    fail(ErrorKind::data, "{}: the mask has {}x{} pixels, but its image has {}x{}", path.string(), mask.cols,
         mask.rows, image.width, image.height);
  // The mask is the alpha channel. If there is none, or if alpha is 255 everywhere, the mask is the brightest
  // colour channel, so that only pixels in which all colour channels are dark are masked (see set_mask()).
  const int channels = mask.channels(), colours = std::min(channels, 3);
  const int full = mask.depth() == CV_8U ? 255 : 65535;
  const auto value = [&](int x, int y, int channel) {
    const int at = x * channels + channel;
    return mask.depth() == CV_8U ? int{mask.ptr<std::uint8_t>(y)[at]} : int{mask.ptr<std::uint16_t>(y)[at]};
  };
  bool alpha = false;
  for (int y = 0; y < mask.rows && channels == 4; ++y)
    for (int x = 0; x < mask.cols; ++x) alpha |= value(x, y, 3) < full;
  std::vector<int> values;
  values.reserve(sample_count(mask.cols, mask.rows, 1));
  for (int y = 0; y < mask.rows; ++y)
    for (int x = 0; x < mask.cols; ++x) {
      int brightest = 0;
      for (int c = 0; c < colours; ++c) brightest = std::max(brightest, value(x, y, c));
      values.push_back(alpha ? value(x, y, 3) : brightest);
    }
  // Some programs write masks with the values 0 and 1 instead of 0 and 255.
  const bool ones = std::ranges::max(values) == 1;
  if (ones) warn_once("masks have only the values 0 and 1: pixels with the value 1 are used");
  const int unit = ones ? 1 : full;
  Image8 grey{mask.cols, mask.rows, {}, {}};
  grey.rgb.reserve(sample_count(mask.cols, mask.rows, 3));
  for (const int v : values) grey.rgb.insert(grey.rgb.end(), 3, static_cast<std::uint8_t>(v * 255 / unit));
  if (mask.cols == image.width && mask.rows == image.height) return grey;
  return resize_bicubic(grey, image.width, image.height);
}

ImageInfo decoded_info(const std::filesystem::path& path) {
  const PixelData image = decode_image_file(path);
  return {{image.pixels.cols, image.pixels.rows}, image.orientation, image.pixels.channels() < 4};
}

}  // namespace ubs
