// SPDX-License-Identifier: Apache-2.0
// See page_picture.hpp. OpenCV encodes and reduces the images, and provides the colour maps.
#include "host/look/report/page_picture.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "host/base/error.hpp"
#include "host/dataset/opencv_parts.hpp"
#include "host/look/report/html.hpp"
#include "host/model/picture.hpp"

namespace ubs {
namespace {

// If a PNG has more than kPngBytes bytes, or more bytes than the caller allows, page_picture() encodes the
// image as a JPEG instead. At the first quality, the errors of the JPEG are about 1/255, which is too small
// to matter for viewing. The other qualities are used only if the caller limits the number of bytes.
constexpr std::array kJpegQualities{92, 80, 65, 50};
constexpr std::size_t kPngBytes = 64 << 10;

cv::Mat bgr_of(const Image8& image) {
  const cv::Mat rgb(image.height, image.width, CV_8UC3, const_cast<std::uint8_t*>(image.rgb.data()));
  cv::Mat bgr;
  cv::cvtColor(rgb, bgr, cv::COLOR_RGB2BGR);
  return bgr;
}

std::vector<std::uint8_t> encode(const cv::Mat& bgr, const char* extension, const std::vector<int>& options) {
  std::vector<std::uint8_t> bytes;
  if (!opencv().imencode(extension, bgr, bytes, options))
    fail(ErrorKind::internal, "an image of {} x {} pixels cannot be encoded as {}", bgr.cols, bgr.rows,
         extension);
  return bytes;
}

// Applies a colour map of OpenCV to grey values from 0 to 255.
Image8 mapped(const cv::Mat& grey, int map) {
  cv::Mat bgr, rgb;
  cv::applyColorMap(grey, bgr, map);
  cv::cvtColor(bgr, rgb, cv::COLOR_BGR2RGB);
  return {rgb.cols, rgb.rows, {rgb.data, rgb.data + rgb.total() * 3}};
}

std::uint8_t byte_of(double unit) {
  return std::isfinite(unit) ? static_cast<std::uint8_t>(std::lround(255 * std::clamp(unit, 0.0, 1.0)))
                             : std::uint8_t{0};
}

void check_same_size(const Image8& a, const Image8& b) {
  if (a.width != b.width || a.height != b.height)
    fail(ErrorKind::internal, "images of {} x {} and {} x {} pixels cannot be compared", a.width, a.height,
         b.width, b.height);
}

constexpr int kErrorMap = cv::COLORMAP_INFERNO, kDepthMap = cv::COLORMAP_VIRIDIS;

}  // namespace

std::string page_picture(const Image8& image, int longest, std::size_t most_bytes) {
  cv::Mat bgr = bgr_of(image);
  if (const double by = static_cast<double>(std::max(bgr.cols, bgr.rows)) / longest; by > 1) {
    const auto reduced = [&](int size) { return std::max(1, static_cast<int>(std::lround(size / by))); };
    cv::resize(bgr, bgr, {reduced(bgr.cols), reduced(bgr.rows)}, 0, 0, cv::INTER_AREA);
  }
  std::vector<std::uint8_t> bytes = encode(bgr, ".png", {cv::IMWRITE_PNG_COMPRESSION, 9});
  const char* type = "png";
  if (bytes.size() > std::min(kPngBytes, most_bytes)) {
    type = "jpeg";
    for (const int quality : kJpegQualities) {
      bytes = encode(bgr, ".jpg", {cv::IMWRITE_JPEG_QUALITY, quality});
      if (bytes.size() <= most_bytes) break;
    }
  }
  return fmt::format("data:image/{};base64,{}", type, base64(bytes));
}

Image8 error_image(const Image8& a, const Image8& b, double top) {
  check_same_size(a, b);
  cv::Mat grey(a.height, a.width, CV_8UC1);
  for (std::size_t i = 0; i < a.rgb.size() / 3; ++i) {
    int sum = 0;
    for (std::size_t c = 0; c < 3; ++c) sum += std::abs(int{a.rgb[3 * i + c]} - int{b.rgb[3 * i + c]});
    grey.data[i] = byte_of(sum / (3 * 255.0) / top);
  }
  return mapped(grey, kErrorMap);
}

ValueRange central_depth_range(std::span<const float> depth, std::span<const float> alpha) {
  std::vector<float> values;
  for (const float least : {0.5f, 0.0f}) {
    for (std::size_t i = 0; i < depth.size(); ++i)
      if (alpha[i] >= least && std::isfinite(depth[i])) values.push_back(depth[i]);
    if (!values.empty()) break;
  }
  if (values.empty()) return {};
  const DepthRange found = depth_percentiles(std::move(values));
  ValueRange range{found.near, found.far};
  if (!(range.high > range.low)) range.high = range.low + std::max(1e-6, 1e-3 * std::abs(range.low));
  return range;
}

Image8 depth_image(std::span<const float> depth, std::span<const float> alpha, int width, int height,
                   ValueRange range) {
  cv::Mat grey(height, width, CV_8UC1);
  for (std::size_t i = 0; i < depth.size(); ++i)
    grey.data[i] = byte_of((range.high - depth[i]) / (range.high - range.low));
  Image8 image = mapped(grey, kDepthMap);
  for (std::size_t i = 0; i < image.rgb.size(); ++i)
    image.rgb[i] = byte_of(image.rgb[i] / 255.0 * std::clamp(double{alpha[i / 3]}, 0.0, 1.0));
  return image;
}

Image8 grey_image(std::span<const float> values, int width, int height) {
  Image8 image{width, height, {}};
  image.rgb.reserve(3 * values.size());
  for (const float v : values) image.rgb.insert(image.rgb.end(), 3, byte_of(v));
  return image;
}

double psnr_channel_mean(const Image8& a, const Image8& b) {
  check_same_size(a, b);
  std::array<double, 3> sums{};
  for (std::size_t i = 0; i < a.rgb.size(); ++i) {
    const double difference = (int{a.rgb[i]} - int{b.rgb[i]}) / 255.0;
    sums[i % 3] += difference * difference;
  }
  double mean = 0;
  for (const double sum : sums) mean += 10 * std::log10(static_cast<double>(a.rgb.size() / 3) / sum) / 3;
  return mean;
}

}  // namespace ubs
