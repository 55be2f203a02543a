// SPDX-License-Identifier: Apache-2.0
#include "host/data/corners.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <opencv2/core/hal/hal.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include "host/base/vector3.hpp"

namespace ubs {
namespace {

constexpr int kSearchedAcross = 800;     // [px] images are reduced to this size before the search
constexpr int kCorners = 2000;           // maximum number of dense corners per image
constexpr double kCornerQuality = 2e-3;  // minimum quality, relative to the strongest corner
constexpr double kCornerDistance = 2;    // [px] minimum distance between two corners
constexpr float kCornerSize = 3;         // [px] size of the descriptor of a dense corner
constexpr int kFeatures = 3000, kOctaveLayers = 3;
// OpenCV's default is 0.04, which gives too few features in small images.
constexpr double kFeatureContrast = 0.005;
constexpr double kStrip = 16;  // [px] width of the strips that corners are sorted into
// Maximum ratio of the distances of the best and the second best descriptor in the band.
constexpr float kRatio = 0.85f;

// Returns the corners at most `band` away from the line a u + b v + c = 0, whose normal has unit length.
std::vector<std::size_t> near_line(const Corners& in, const Vec3& line, double band) {
  std::vector<std::size_t> found;
  const double b = std::copysign(std::max(std::abs(line[1]), 1e-9), line[1]);
  const auto row = [&](std::size_t k) { return in.at[k][1]; };
  for (std::size_t s = 0; s < in.strips.size(); ++s) {
    const double left = -(line[0] * kStrip * static_cast<double>(s) + line[2]) / b;
    const double right = left - line[0] * kStrip / b, slack = band / std::abs(b);
    const auto first = std::ranges::lower_bound(in.strips[s], std::min(left, right) - slack, {}, row);
    const auto last = std::ranges::upper_bound(in.strips[s], std::max(left, right) + slack, {}, row);
    std::copy_if(first, last, std::back_inserter(found), [&](std::size_t k) {
      return std::abs(line[0] * in.at[k][0] + line[1] * in.at[k][1] + line[2]) <= band;
    });
  }
  return found;
}

}  // namespace

Corners find_corners(const View& view, CornerKind kind) {
  Corners out;
  const Image8 image = view.load_image();
  const cv::Mat rgb(image.height, image.width, CV_8UC3, const_cast<std::uint8_t*>(image.rgb.data()));
  const double reduced = std::max(1.0, 1.0 * std::max(image.width, image.height) / kSearchedAcross);
  cv::Mat grey, mask;
  cv::cvtColor(rgb, grey, cv::COLOR_RGB2GRAY);
  cv::Mat all;
  if (!image.mask.empty())
    all = cv::Mat(image.height, image.width, CV_8UC1, const_cast<std::uint8_t*>(image.mask.data()));
  if (reduced > 1) {
    cv::resize(grey, grey, {}, 1 / reduced, 1 / reduced, cv::INTER_AREA);
    if (!all.empty()) cv::resize(all, mask, grey.size(), 0, 0, cv::INTER_NEAREST);
  } else {
    mask = all;
  }
  std::vector<cv::KeyPoint> found;
  if (kind == CornerKind::distinct) {
    cv::SIFT::create(kFeatures, kOctaveLayers, kFeatureContrast)
        ->detectAndCompute(grey, mask, found, out.descriptors);
  } else {
    cv::GFTTDetector::create(kCorners, kCornerQuality, kCornerDistance)->detect(grey, found, mask);
    for (cv::KeyPoint& key : found) key.size = kCornerSize, key.octave = 0, key.angle = 0;
    // SIFT::compute() throws for an empty keypoint list if the image is too small for an octave.
    if (!found.empty()) cv::SIFT::create()->compute(grey, found, out.descriptors);
  }
  out.picture = {.camera = view.camera,
                 .width = grey.cols,
                 .height = grey.rows,
                 .across = 1.0 * image.width / grey.cols,
                 .down = 1.0 * image.height / grey.rows};
  out.picture.values.assign(grey.begin<std::uint8_t>(), grey.end<std::uint8_t>());
  for (const cv::KeyPoint& key : found) {
    const Pixel at{(key.pt.x + 0.5) * out.picture.across, (key.pt.y + 0.5) * out.picture.down};
    out.rays.push_back(view.camera.ray(at[0], at[1]));
    out.at.push_back(at);
    const auto pixel = image.rgb.begin() + static_cast<std::ptrdiff_t>(3 * pixel_index(image, at));
    std::copy_n(pixel, 3, out.colours.emplace_back().begin());
  }
  out.strips.resize(static_cast<std::size_t>(image.width / kStrip) + 1);
  for (std::size_t k = 0; k < out.at.size(); ++k)
    out.strips[static_cast<std::size_t>(out.at[k][0] / kStrip)].push_back(k);
  for (auto& strip : out.strips) std::ranges::sort(strip, {}, [&](std::size_t k) { return out.at[k][1]; });
  return out;
}

std::vector<std::pair<std::size_t, std::size_t>> neighbours(std::span<const Camera> cameras,
                                                            std::size_t most) {
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    const Camera& a = cameras[i];
    std::vector<std::pair<double, std::size_t>> others;
    for (std::size_t j = 0; j < cameras.size(); ++j) {
      const Camera& b = cameras[j];
      double same = 0;
      for (std::size_t k = 0; k < 3; ++k) same += a.rotation[6 + k] * b.rotation[6 + k];
      const double far = length(a.centre() - b.centre());
      if (same > 0.5 && far > 0) others.emplace_back(far * (2 - same), j);
    }
    const std::size_t count = std::min(most, others.size());
    std::partial_sort(others.begin(), others.begin() + static_cast<std::ptrdiff_t>(count), others.end());
    for (std::size_t n = 0; n < count; ++n)
      pairs.emplace_back(std::min(i, others[n].second), std::max(i, others[n].second));
  }
  std::ranges::sort(pairs);
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  return pairs;
}

Vec3 in_camera(const Camera& c, const Vec3& p) { return c.translation + rotated(c.rotation, p); }

std::optional<Pixel> seen_at(const Camera& c, const Vec3& p) {
  const Vec3 q = in_camera(c, p);
  if (!(q[2] > 0)) return std::nullopt;
  return Pixel{c.fx * q[0] / q[2] + c.cx, c.fy * q[1] / q[2] + c.cy};
}

std::vector<std::ptrdiff_t> best_along_lines(const Corners& from, const Corners& to, double band) {
  const Camera &a = from.camera(), &b = to.camera();
  std::vector<std::ptrdiff_t> best(from.rays.size(), -1);
  const Vec3 base = a.centre() - b.centre();
  band *= to.pixel();
  for (std::size_t i = 0; i < from.rays.size(); ++i) {
    // The plane that contains the ray and both cameras, as a line in the image of b.
    const Vec3 n = rotated(b.rotation, cross(base, from.rays[i]));
    Vec3 line{n[0] / b.fx, n[1] / b.fy, n[2] - n[0] * b.cx / b.fx - n[1] * b.cy / b.fy};
    const double size = std::hypot(line[0], line[1]);
    if (!(size > 0)) continue;
    for (double& l : line) l /= size;
    float first = 1e30f, second = 1e30f;
    const float* mine = from.descriptors.ptr<float>(static_cast<int>(i));
    for (const std::size_t j : near_line(to, line, band)) {
      const float d =
          cv::hal::normL2Sqr_(mine, to.descriptors.ptr<float>(static_cast<int>(j)), to.descriptors.cols);
      if (d < first)
        second = first, first = d, best[i] = static_cast<std::ptrdiff_t>(j);
      else
        second = std::min(second, d);
    }
    if (first > kRatio * kRatio * second) best[i] = -1;
  }
  return best;
}

}  // namespace ubs
