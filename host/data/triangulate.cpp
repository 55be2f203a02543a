// SPDX-License-Identifier: Apache-2.0
// See triangulate.hpp.
#include "host/data/triangulate.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <opencv2/core.hpp>
#include <opencv2/core/hal/hal.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "host/base/parallel.hpp"
#include "host/base/vector3.hpp"

namespace ubs {
namespace {

constexpr int kSearchedAcross = 800;    // [px] of a picture in which corners are sought
constexpr int kCorners = 4000;          // of a picture
constexpr double kContrast = 0.003;     // of a corner, in SIFT's measure: a tenth of what is usual
constexpr std::size_t kNeighbours = 6;  // of a picture, with which it is matched
constexpr double kBand = 2;             // [px] from the epipolar line, and of the point from its corners
constexpr float kRatio = 0.85f;     // of the distances of the best and the second best descriptor in the band
constexpr double kMinAngle = 0.01;  // between two rays

struct Corners {
  std::vector<Vec3> rays;                 // in the world, of unit depth
  std::vector<std::array<double, 2>> at;  // in pixels of the camera
  std::vector<std::array<std::uint8_t, 3>> colours;
  cv::Mat descriptors;  // float, a row a corner
  double pixel = 1;     // pixels of the camera in one of the picture that was searched
};

Corners find_corners(const View& view) {
  Corners out;
  const Image8 image = view.load_image();
  const cv::Mat rgb(image.height, image.width, CV_8UC3, const_cast<std::uint8_t*>(image.rgb.data()));
  out.pixel = std::max(1.0, 1.0 * std::max(image.width, image.height) / kSearchedAcross);
  cv::Mat grey, mask;
  cv::cvtColor(rgb, grey, cv::COLOR_RGB2GRAY);
  cv::Mat all;
  if (!image.mask.empty())
    all = cv::Mat(image.height, image.width, CV_8UC1, const_cast<std::uint8_t*>(image.mask.data()));
  if (out.pixel > 1) {
    cv::resize(grey, grey, {}, 1 / out.pixel, 1 / out.pixel, cv::INTER_AREA);
    if (!all.empty()) cv::resize(all, mask, grey.size(), 0, 0, cv::INTER_NEAREST);
  } else {
    mask = all;
  }
  std::vector<cv::KeyPoint> found;
  cv::SIFT::create(kCorners, 3, kContrast)->detectAndCompute(grey, mask, found, out.descriptors);
  const Camera& c = view.camera;
  for (const cv::KeyPoint& key : found) {
    const double u = (key.pt.x + 0.5) * image.width / grey.cols,
                 v = (key.pt.y + 0.5) * image.height / grey.rows;
    const Vec3 local{(u - c.cx) / c.fx, (v - c.cy) / c.fy, 1};
    Vec3 ray{};
    for (std::size_t k = 0; k < 3; ++k)
      for (std::size_t r = 0; r < 3; ++r) ray[k] += c.rotation[3 * r + k] * local[r];
    const int x = std::clamp(static_cast<int>(u), 0, image.width - 1);
    const int y = std::clamp(static_cast<int>(v), 0, image.height - 1);
    const auto colour = rgb.at<cv::Vec3b>(y, x);
    out.rays.push_back(ray);
    out.at.push_back({u, v});
    out.colours.push_back({colour[0], colour[1], colour[2]});
  }
  return out;
}

// Of each view those that look alike: near in position and direction, but not from the same place.
std::vector<std::pair<std::size_t, std::size_t>> neighbours(std::span<const View> views) {
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const Camera& a = views[i].camera;
    std::vector<std::pair<double, std::size_t>> others;
    for (std::size_t j = 0; j < views.size(); ++j) {
      const Camera& b = views[j].camera;
      double same = 0;
      for (std::size_t k = 0; k < 3; ++k) same += a.rotation[6 + k] * b.rotation[6 + k];
      const double far = length(a.centre() - b.centre());
      if (same > 0.5 && far > 0) others.emplace_back(far * (2 - same), j);
    }
    const std::size_t count = std::min(kNeighbours, others.size());
    std::partial_sort(others.begin(), others.begin() + static_cast<std::ptrdiff_t>(count), others.end());
    for (std::size_t n = 0; n < count; ++n)
      pairs.emplace_back(std::min(i, others[n].second), std::max(i, others[n].second));
  }
  std::ranges::sort(pairs);
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  return pairs;
}

std::optional<std::array<double, 2>> seen_at(const Camera& c, const Vec3& p) {
  double q[3];
  for (std::size_t r = 0; r < 3; ++r)
    q[r] = c.rotation[3 * r] * p[0] + c.rotation[3 * r + 1] * p[1] + c.rotation[3 * r + 2] * p[2] +
           c.translation[r];
  if (!(q[2] > 0)) return std::nullopt;
  return std::array{c.fx * q[0] / q[2] + c.cx, c.fy * q[1] / q[2] + c.cy};
}

struct Match {
  std::size_t a, b;  // corners
  Vec3 point;
  double angle;
};

// Where two rays pass each other, if that is before both cameras.
std::optional<Vec3> meet(const Vec3& p, const Vec3& d, const Vec3& q, const Vec3& e) {
  const Vec3 w = p - q;
  const double dd = dot(d, d), de = dot(d, e), ee = dot(e, e), dw = dot(d, w), ew = dot(e, w);
  const double det = dd * ee - de * de;
  if (!(det > 0)) return std::nullopt;
  const double s = (de * ew - ee * dw) / det, t = (dd * ew - de * dw) / det;
  if (!(s > 0 && t > 0)) return std::nullopt;
  return 0.5 * (p + s * d + q + t * e);
}

// The corner of `to` that looks most like each of `from`, among those near to its epipolar line; or none.
std::vector<std::ptrdiff_t> best_along_lines(const Camera& a, const Corners& from, const Camera& b,
                                             const Corners& to) {
  std::vector<std::ptrdiff_t> best(from.rays.size(), -1);
  const Vec3 base = a.centre() - b.centre();
  const double band = kBand * to.pixel;
  for (std::size_t i = 0; i < from.rays.size(); ++i) {
    // The plane of the ray and both cameras, as a line in the picture of b.
    const Vec3 normal = cross(base, from.rays[i]);
    double n[3];
    for (std::size_t r = 0; r < 3; ++r)
      n[r] = b.rotation[3 * r] * normal[0] + b.rotation[3 * r + 1] * normal[1] +
             b.rotation[3 * r + 2] * normal[2];
    double line[3] = {n[0] / b.fx, n[1] / b.fy, n[2] - n[0] * b.cx / b.fx - n[1] * b.cy / b.fy};
    const double size = std::hypot(line[0], line[1]);
    if (!(size > 0)) continue;
    for (double& l : line) l /= size;
    float first = 1e30f, second = 1e30f;
    const float* mine = from.descriptors.ptr<float>(static_cast<int>(i));
    for (std::size_t j = 0; j < to.at.size(); ++j) {
      if (std::abs(line[0] * to.at[j][0] + line[1] * to.at[j][1] + line[2]) > band) continue;
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

std::vector<Match> match(const View& a, const Corners& in_a, const View& b, const Corners& in_b) {
  std::vector<Match> matches;
  const auto there = best_along_lines(a.camera, in_a, b.camera, in_b);
  const auto back = best_along_lines(b.camera, in_b, a.camera, in_a);
  for (std::size_t i = 0; i < there.size(); ++i) {
    if (there[i] < 0) continue;
    const auto j = static_cast<std::size_t>(there[i]);
    if (back[j] != static_cast<std::ptrdiff_t>(i)) continue;
    const Vec3 &d = in_a.rays[i], &e = in_b.rays[j];
    const auto point = meet(a.camera.centre(), d, b.camera.centre(), e);
    const double angle = std::atan2(length(cross(d, e)), dot(d, e));
    if (!point || angle < kMinAngle) continue;
    const auto off = [&](const Camera& c, const Corners& in, std::size_t k) {
      const auto at = seen_at(c, *point);
      return !at || std::hypot((*at)[0] - in.at[k][0], (*at)[1] - in.at[k][1]) > kBand * in.pixel;
    };
    if (off(a.camera, in_a, i) || off(b.camera, in_b, j)) continue;
    matches.push_back({i, j, *point, angle});
  }
  return matches;
}

}  // namespace

Triangulation triangulate(std::span<const View> all, std::size_t pictures) {
  std::vector<View> views;
  for (std::size_t v = 0; v < all.size(); v += all.size() / pictures + 1)
    if (all[v].has_image()) views.push_back(all[v]);
  std::vector<Corners> corners(views.size());
  parallel_for(views.size(), [&](std::size_t v) { corners[v] = find_corners(views[v]); });
  const auto pairs = neighbours(views);
  std::vector<std::vector<Match>> matches(pairs.size());
  parallel_for(pairs.size(), [&](std::size_t p) {
    const auto [a, b] = pairs[p];
    matches[p] = match(views[a], corners[a], views[b], corners[b]);
  });

  // Corners that are one point: sets, by their representative.
  std::vector<std::size_t> first(views.size() + 1);
  for (std::size_t v = 0; v < views.size(); ++v) first[v + 1] = first[v] + corners[v].at.size();
  std::vector<std::size_t> parent(first.back());
  std::iota(parent.begin(), parent.end(), std::size_t{0});
  const auto root = [&](std::size_t k) {
    while (parent[k] != k) k = parent[k] = parent[parent[k]];
    return k;
  };
  for (std::size_t p = 0; p < pairs.size(); ++p)
    for (const Match& m : matches[p]) {
      const std::size_t a = root(first[pairs[p].first] + m.a), b = root(first[pairs[p].second] + m.b);
      parent[std::max(a, b)] = std::min(a, b);
    }
  struct Best {
    const Match* match;
    std::size_t view;
  };
  std::map<std::size_t, Best> points;
  for (std::size_t p = 0; p < pairs.size(); ++p)
    for (const Match& m : matches[p]) {
      const std::size_t set = root(first[pairs[p].first] + m.a);
      const auto [at, fresh] = points.try_emplace(set, Best{&m, pairs[p].first});
      if (!fresh && m.angle > at->second.match->angle) at->second = {&m, pairs[p].first};
    }
  Triangulation out;
  out.seen.resize(all.size());
  const std::size_t step = all.size() / pictures + 1;
  for (const auto& [set, best] : points) {
    const Vec3& p = best.match->point;
    out.points.positions.push_back(
        {static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2])});
    out.points.colours.push_back(corners[best.view].colours[best.match->a]);
  }
  for (std::size_t v = 0; v < views.size(); ++v) {
    const Camera& c = views[v].camera;
    for (std::size_t k = 0; k < corners[v].at.size(); ++k) {
      const auto point = points.find(root(first[v] + k));
      if (point == points.end()) continue;
      const Vec3 p = point->second.match->point - c.centre();
      const double depth = c.rotation[6] * p[0] + c.rotation[7] * p[1] + c.rotation[8] * p[2];
      if (depth > 0) out.seen[v * step].push_back({corners[v].at[k][0], corners[v].at[k][1], depth});
    }
  }
  return out;
}

}  // namespace ubs
