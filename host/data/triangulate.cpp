// SPDX-License-Identifier: Apache-2.0
// See triangulate.hpp.
#include "host/data/triangulate.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <numeric>
#include <opencv2/core.hpp>
#include <opencv2/core/hal/hal.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "host/base/parallel.hpp"
#include "host/base/philox.hpp"
#include "host/base/vector3.hpp"
#include "host/data/patch_depth.hpp"

namespace ubs {
namespace {

constexpr int kSearchedAcross = 800;     // [px] of a picture in which corners are sought
constexpr int kCorners = 2000;           // of a picture
constexpr double kCornerQuality = 2e-3;  // of the strongest one
constexpr double kCornerDistance = 2;    // [px] between two
constexpr float kCornerSize = 3;         // [px] that the descriptor is made for
constexpr std::size_t kNeighbours = 6;   // of a picture, with which it is matched
constexpr double kBand = 2;              // [px] from the epipolar line, and of the point from its corners
constexpr double kStrip = 16;            // [px] wide, in which corners are sorted
constexpr float kRatio = 0.85f;     // of the distances of the best and the second best descriptor in the band
constexpr double kMinAngle = 0.01;  // between two rays
constexpr double kAgreement = 0.8;  // of the patches about two corners that are the same point
constexpr double kRefined = 0.05;   // more and less than where the rays meet, as a share of 1/depth
constexpr int kRefinedDepths = 11;  // tried there

// Pixels between corners.
constexpr std::size_t kAround = 8;        // corners, whose depths bound that of a pixel between them
constexpr double kBeyond = 0.1;           // further than these, as a share of 1/depth
constexpr int kDepths = 16;               // tried
constexpr std::size_t kComparedWith = 4;  // of the matched pictures, those taken from nearest
constexpr double kPlacedAgreement = 0.85;
constexpr std::size_t kTries = 4;  // pixels drawn for one that is placed
constexpr std::uint32_t kStream = 0x706c6163;

struct Corners {
  GreyPicture picture;
  std::vector<Vec3> rays;  // in the world, of unit depth
  std::vector<Pixel> at;
  std::vector<std::array<std::uint8_t, 3>> colours;
  cv::Mat descriptors;                           // float, a row a corner
  std::vector<std::vector<std::size_t>> strips;  // corners by column, then by row
  const Camera& camera() const { return picture.camera; }
  double pixel() const { return picture.across; }  // of the searched picture, in pixels of the camera
};

void add(PointCloud& cloud, const Vec3& p, const std::uint8_t* colour) {
  cloud.positions.push_back({static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2])});
  cloud.colours.push_back({colour[0], colour[1], colour[2]});
}

double depth_of(const Camera& c, const Vec3& p) {
  return dot({c.rotation[6], c.rotation[7], c.rotation[8]}, p) + c.translation[2];
}

// Of the pixel that `at` lies in.
std::size_t pixel_index(const Image8& image, const Pixel& at) {
  const int x = std::clamp(static_cast<int>(at[0]), 0, image.width - 1);
  const int y = std::clamp(static_cast<int>(at[1]), 0, image.height - 1);
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) + static_cast<std::size_t>(x);
}

Corners find_corners(const View& view) {
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
  cv::GFTTDetector::create(kCorners, kCornerQuality, kCornerDistance)->detect(grey, found, mask);
  for (cv::KeyPoint& key : found) key.size = kCornerSize, key.octave = 0, key.angle = 0;
  cv::SIFT::create()->compute(grey, found, out.descriptors);
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

std::optional<Pixel> seen_at(const Camera& c, const Vec3& p) {
  double q[3];
  for (std::size_t r = 0; r < 3; ++r)
    q[r] = c.rotation[3 * r] * p[0] + c.rotation[3 * r + 1] * p[1] + c.rotation[3 * r + 2] * p[2] +
           c.translation[r];
  if (!(q[2] > 0)) return std::nullopt;
  return Pixel{c.fx * q[0] / q[2] + c.cx, c.fy * q[1] / q[2] + c.cy};
}

struct Match {
  std::size_t a, b;  // corners
  std::array<std::uint8_t, 3> colour;
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

// Corners at most `band` from a line a u + b v + c = 0, of unit normal.
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

// The corner of `to` that looks most like each of `from`, among those near to its epipolar line; or none.
std::vector<std::ptrdiff_t> best_along_lines(const Corners& from, const Corners& to) {
  const Camera &a = from.camera(), &b = to.camera();
  std::vector<std::ptrdiff_t> best(from.rays.size(), -1);
  const Vec3 base = a.centre() - b.centre();
  const double band = kBand * to.pixel();
  for (std::size_t i = 0; i < from.rays.size(); ++i) {
    // The plane of the ray and both cameras, as a line in the picture of b.
    const Vec3 normal = cross(base, from.rays[i]);
    double n[3];
    for (std::size_t r = 0; r < 3; ++r)
      n[r] = b.rotation[3 * r] * normal[0] + b.rotation[3 * r + 1] * normal[1] +
             b.rotation[3 * r + 2] * normal[2];
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

std::vector<Match> match(const Corners& a, const Corners& b) {
  std::vector<Match> matches;
  const auto there = best_along_lines(a, b), back = best_along_lines(b, a);
  for (std::size_t i = 0; i < there.size(); ++i) {
    if (there[i] < 0) continue;
    const auto j = static_cast<std::size_t>(there[i]);
    if (back[j] != static_cast<std::ptrdiff_t>(i)) continue;
    const Vec3 &d = a.rays[i], &e = b.rays[j];
    const auto point = meet(a.camera().centre(), d, b.camera().centre(), e);
    const double angle = std::atan2(length(cross(d, e)), dot(d, e));
    if (!point || angle < kMinAngle) continue;
    const auto off = [&](const Corners& in, std::size_t k) {
      const auto at = seen_at(in.camera(), *point);
      return !at || std::hypot((*at)[0] - in.at[k][0], (*at)[1] - in.at[k][1]) > kBand * in.pixel();
    };
    if (off(a, i) || off(b, j)) continue;
    // Corners are whole pixels: the patches about them know better.
    const double depth = depth_of(a.camera(), *point);
    const GreyPicture* const other = &b.picture;
    const auto better = Patch(a.picture, a.at[i])
                            .best_depth({&other, 1}, depth / (1 + kRefined), depth / (1 - kRefined),
                                        kRefinedDepths, kAgreement);
    if (better) matches.push_back({i, j, a.colours[i], a.camera().centre() + *better * d, angle});
  }
  return matches;
}

// Corners of all pictures that are one point, told by the smallest of their numbers.
class Tracks {
 public:
  explicit Tracks(std::size_t corners) : parent_(corners) { std::iota(parent_.begin(), parent_.end(), 0); }
  std::size_t of(std::size_t k) {
    while (parent_[k] != k) k = parent_[k] = parent_[parent_[k]];
    return k;
  }
  void join(std::size_t a, std::size_t b) { parent_[std::max(of(a), of(b))] = std::min(of(a), of(b)); }

 private:
  std::vector<std::size_t> parent_;
};

struct SeenPoint {
  Pixel at;
  double depth;
};

// Points at random pixels of a picture that some of `others` show at a depth like that of corners around.
void place_between(const View& view, const GreyPicture& picture, std::span<const GreyPicture* const> others,
                   std::span<const SeenPoint> seen, std::size_t count, const CounterRandom& random,
                   std::uint64_t first_draw, PointCloud& out) {
  const Image8 image = view.load_image();
  std::vector<std::pair<double, double>> around(seen.size());  // distance, depth
  const std::size_t near = std::min(kAround, seen.size());
  for (std::size_t n = 0; n < kTries * count && out.positions.size() < count; ++n) {
    const Pixel at{random.uniform(first_draw + n, 0) * image.width,
                   random.uniform(first_draw + n, 1) * image.height};
    const std::size_t pixel = pixel_index(image, at);
    const Patch patch(picture, at);
    if (patch.plain() || (!image.mask.empty() && image.mask[pixel] == 0)) continue;
    std::ranges::transform(seen, around.begin(), [&](const SeenPoint& s) {
      return std::pair(std::hypot(s.at[0] - at[0], s.at[1] - at[1]), s.depth);
    });
    std::ranges::nth_element(around, around.begin() + static_cast<std::ptrdiff_t>(near - 1));
    const auto [nearest, farthest] =
        std::minmax_element(around.begin(), around.begin() + static_cast<std::ptrdiff_t>(near),
                            [](const auto& a, const auto& b) { return a.second < b.second; });
    const auto depth = patch.best_depth(others, nearest->second / (1 + kBeyond),
                                        farthest->second / (1 - kBeyond), kDepths, kPlacedAgreement);
    if (!depth) continue;
    add(out, view.camera.centre() + *depth * view.camera.ray(at[0], at[1]), &image.rgb[3 * pixel]);
  }
}

}  // namespace

Triangulation triangulate(std::span<const View> all, std::size_t between, std::uint64_t seed,
                          std::size_t pictures) {
  std::vector<View> views;
  for (std::size_t v = 0; v < all.size(); v += all.size() / pictures + 1)
    if (all[v].has_image()) views.push_back(all[v]);
  std::vector<Corners> corners(views.size());
  parallel_for(views.size(), [&](std::size_t v) { corners[v] = find_corners(views[v]); });
  const auto pairs = neighbours(views);
  std::vector<std::vector<Match>> matches(pairs.size());
  parallel_for(pairs.size(), [&](std::size_t p) {
    const auto [a, b] = pairs[p];
    matches[p] = match(corners[a], corners[b]);
  });

  std::vector<std::size_t> first(views.size() + 1);
  for (std::size_t v = 0; v < views.size(); ++v) first[v + 1] = first[v] + corners[v].at.size();
  Tracks tracks(first.back());
  for (std::size_t p = 0; p < pairs.size(); ++p)
    for (const Match& m : matches[p]) tracks.join(first[pairs[p].first] + m.a, first[pairs[p].second] + m.b);
  std::map<std::size_t, const Match*> points;  // by track
  for (std::size_t p = 0; p < pairs.size(); ++p)
    for (const Match& m : matches[p]) {
      const auto [at, fresh] = points.try_emplace(tracks.of(first[pairs[p].first] + m.a), &m);
      if (!fresh && m.angle > at->second->angle) at->second = &m;
    }
  Triangulation out;
  for (const auto& [track, best] : points) add(out.points, best->point, best->colour.data());
  out.corners = points.size();

  std::vector<std::vector<const GreyPicture*>> others(views.size());
  for (const auto& [a, b] : pairs) {
    others[a].push_back(&corners[b].picture);
    others[b].push_back(&corners[a].picture);
  }
  for (std::size_t v = 0; v < views.size(); ++v) {
    std::ranges::sort(others[v], {}, [&](const GreyPicture* other) {
      return length(other->camera.centre() - views[v].camera.centre());
    });
    others[v].resize(std::min(others[v].size(), kComparedWith));
  }
  const CounterRandom random(seed, kStream);
  const std::size_t share = views.empty() ? 0 : between / views.size() + 1;
  std::vector<PointCloud> placed(views.size());
  std::vector<std::vector<SeenPoint>> seen(views.size());
  for (std::size_t v = 0; v < views.size(); ++v)
    for (std::size_t k = 0; k < corners[v].at.size(); ++k) {
      const auto point = points.find(tracks.of(first[v] + k));
      if (point == points.end()) continue;
      const double depth = depth_of(views[v].camera, point->second->point);
      if (depth > 0) seen[v].push_back({corners[v].at[k], depth});
    }
  parallel_for(between > 0 ? views.size() : 0, [&](std::size_t v) {
    if (!seen[v].empty())
      place_between(views[v], corners[v].picture, others[v], seen[v], share, random, v * kTries * share,
                    placed[v]);
  });
  for (const PointCloud& cloud : placed) {
    std::ranges::copy(cloud.positions, std::back_inserter(out.points.positions));
    std::ranges::copy(cloud.colours, std::back_inserter(out.points.colours));
  }
  return out;
}

}  // namespace ubs
