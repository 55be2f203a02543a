// SPDX-License-Identifier: Apache-2.0
// See corners.hpp.
#include "host/dataset/corners.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <opencv2/core/hal/hal.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include "host/base/vector3.hpp"

namespace ubs {
namespace {

constexpr int kSearchedAcross = 800;     // [px] images with a longer side are reduced to this size first
constexpr int kCorners = 2000;           // maximum number of dense corners per image
constexpr double kCornerQuality = 2e-3;  // minimum quality, relative to the strongest corner
constexpr double kCornerDistance = 2;    // [px] minimum distance between two corners
constexpr float kCornerSize = 3;         // [px] size of the descriptor of a dense corner
// Parameters of SIFT for distinct corners: maximum number of corners per image, and layers per octave.
constexpr int kFeatures = 3000, kOctaveLayers = 3;
// Contrast threshold of SIFT. OpenCV's default is 0.04, which gives too few features in small images.
constexpr double kFeatureContrast = 0.005;
constexpr double kCell = 16;  // [px of the searched image] side of the cells that corners are sorted into
// A match is accepted if the distance to the best descriptor in the search band is at most this fraction of
// the distance to the second best.
constexpr float kRatio = 0.85f;

void sort_into_cells(Corners& corners, const Image8& image) {
  corners.cell = kCell * corners.pixel();
  const auto cells = [&](double length) { return static_cast<std::size_t>(length / corners.cell); };
  corners.cells_down = cells(image.height) + 1;
  const auto cell_of = [&](std::size_t k) {
    return cells(corners.at[k][0]) * corners.cells_down + cells(corners.at[k][1]);
  };
  corners.first.assign((cells(image.width) + 1) * corners.cells_down + 1, 0);
  for (std::size_t k = 0; k < corners.at.size(); ++k) ++corners.first[cell_of(k) + 1];
  std::partial_sum(corners.first.begin(), corners.first.end(), corners.first.begin());
  corners.sorted.resize(corners.at.size());
  std::iota(corners.sorted.begin(), corners.sorted.end(), std::size_t{0});
  std::ranges::stable_sort(corners.sorted, {}, cell_of);
}

// Calls visit() for the corners that are at most `band` away from the line a u + b v + c = 0. The length of
// the vector (a, b) must be 1.
template <typename Visit>
void for_near_line(const Corners& in, const Vec3& line, double band, const Visit& visit) {
  if (in.at.empty()) return;
  const double b = std::copysign(std::max(std::abs(line[1]), 1e-9), line[1]);
  // `left` is the row in which the line crosses the left border of the current column of cells. `step` is the
  // number of rows by which the line descends within a column, and `slack` is half the height of the band.
  // All three are in units of cells.
  double left = -line[2] / (b * in.cell);
  const double step = -line[0] / b, slack = band / (std::abs(b) * in.cell);
  const auto last = static_cast<double>(in.cells_down - 1);
  for (std::size_t c = 0; c + 1 < in.first.size(); c += in.cells_down, left += step) {
    const double top = std::min(left, left + step) - slack, bottom = std::max(left, left + step) + slack;
    if (!(bottom >= 0 && top < last + 1)) continue;
    const std::size_t from = in.first[c + static_cast<std::size_t>(std::max(top, 0.0))];
    const std::size_t to = in.first[c + static_cast<std::size_t>(std::min(bottom, last)) + 1];
    for (std::size_t i = from; i < to; ++i) {
      const std::size_t k = in.sorted[i];
      if (std::abs(line[0] * in.at[k][0] + line[1] * in.at[k][1] + line[2]) <= band) visit(k);
    }
  }
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
  sort_into_cells(out, image);
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
    // Compute the epipolar line, in which the image plane of b intersects the plane that contains the ray and
    // both camera centres.
    const Vec3 n = rotated(b.rotation, cross(base, from.rays[i]));
    Vec3 line{n[0] / b.fx, n[1] / b.fy, n[2] - n[0] * b.cx / b.fx - n[1] * b.cy / b.fy};
    const double size = std::hypot(line[0], line[1]);
    if (!(size > 0)) continue;
    for (double& l : line) l /= size;
    float first = 1e30f, second = 1e30f;
    const float* mine = from.descriptors.ptr<float>(static_cast<int>(i));
    for_near_line(to, line, band, [&](std::size_t j) {
      const float d =
          cv::hal::normL2Sqr_(mine, to.descriptors.ptr<float>(static_cast<int>(j)), to.descriptors.cols);
      if (d < first)
        second = first, first = d, best[i] = static_cast<std::ptrdiff_t>(j);
      else
        second = std::min(second, d);
    });
    if (first > kRatio * kRatio * second) best[i] = -1;
  }
  return best;
}

}  // namespace ubs
