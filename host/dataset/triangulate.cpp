// SPDX-License-Identifier: Apache-2.0
// See triangulate.hpp.
#include "host/dataset/triangulate.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <optional>

#include "host/base/parallel.hpp"
#include "host/base/philox.hpp"
#include "host/base/vector3.hpp"
#include "host/dataset/corners.hpp"

namespace ubs {
namespace {

constexpr std::size_t kNeighbours = 6;  // number of images that each image is matched with
// Maximum distance of a match from the epipolar line, and of the projected point from its corners, in pixels
// of the searched image (corners.hpp).
constexpr double kBand = 2;
constexpr double kMinAngle = 0.01;  // minimum angle between two rays [rad]
constexpr double kAgreement = 0.8;  // minimum correlation of the patches around two matched corners
// The depth is searched around the intersection of the rays. 1/depth may differ by this fraction.
constexpr double kRefined = 0.05;
constexpr int kRefinedDepths = 11;  // number of depths tried in this range

// Constants for the pixels between corners.
constexpr std::size_t kAround = 8;  // number of nearest corners whose depths limit the depth of a pixel
constexpr double kBeyond = 0.1;     // fraction of 1/depth by which these limits are extended
constexpr int kDepths = 16;         // number of depths that are tried
// A pixel is compared with this number of other images. They are those with the nearest cameras.
constexpr std::size_t kComparedWith = 4;
constexpr double kPlacedAgreement = 0.85;      // minimum correlation of the patches in these images
constexpr std::size_t kTries = 4;              // maximum number of random pixels that are tried per point
constexpr std::uint32_t kStream = 0x706c6163;  // stream of CounterRandom that chooses these pixels

// Constants for the comparison of brightness.
constexpr std::size_t kMinCompared = 50;  // minimum number of corners that two images have in common
constexpr std::size_t kMinPairs = 3;      // minimum number of pairs of images that are compared
constexpr double kExceeded = 0.9;         // fraction of the pairs whose ratio is smaller than the result
// Brightness values outside of this range are not compared, because noise or clipping changes their ratio.
constexpr double kDarkest = 16, kWhite = 240;

void add(PointCloud& cloud, const Vec3& p, const std::uint8_t* colour) {
  cloud.positions.push_back({static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2])});
  cloud.colours.push_back({colour[0], colour[1], colour[2]});
}

struct Match {
  std::size_t a, b;  // indices of corners
  std::array<std::uint8_t, 3> colour;
  Vec3 point;
  double angle;
};

// Returns the midpoint of the shortest line between two rays, or nullopt if it is not in front of both
// cameras. The rays start at p and q and have the directions d and e.
std::optional<Vec3> meet(const Vec3& p, const Vec3& d, const Vec3& q, const Vec3& e) {
  const Vec3 w = p - q;
  const double dd = dot(d, d), de = dot(d, e), ee = dot(e, e), dw = dot(d, w), ew = dot(e, w);
  const double det = dd * ee - de * de;
  if (!(det > 0)) return std::nullopt;
  const double s = (de * ew - ee * dw) / det, t = (dd * ew - de * dw) / det;
  if (!(s > 0 && t > 0)) return std::nullopt;
  return 0.5 * (p + s * d + q + t * e);
}

std::vector<Match> match(const Corners& a, const Corners& b) {
  std::vector<Match> matches;
  const auto there = best_along_lines(a, b, kBand), back = best_along_lines(b, a, kBand);
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
    // Corners are at whole pixels, so their rays are not accurate. The comparison of the patches around the
    // corners gives a more accurate depth.
    const double depth = in_camera(a.camera(), *point)[2];
    const GreyPicture* const other = &b.picture;
    const auto better = Patch(a.picture, a.at[i])
                            .best_depth({&other, 1}, depth / (1 + kRefined), depth / (1 - kRefined),
                                        kRefinedDepths, kAgreement);
    if (better) matches.push_back({i, j, a.colours[i], a.camera().centre() + *better * d, angle});
  }
  return matches;
}

struct SeenPoint {
  Pixel at;
  double depth;
};

// Adds at most `count` points at random pixels of an image. The depth of a pixel is searched in the range of
// the depths of the nearest corners. A point is added if the images of `others` agree well enough at one of
// the depths.
void place_between(const View& view, const GreyPicture& picture, std::span<const GreyPicture* const> others,
                   std::span<const SeenPoint> seen, std::size_t count, const CounterRandom& random,
                   std::uint64_t first_draw, PointCloud& out) {
  const Image8 image = view.load_image();
  std::vector<std::pair<double, double>> around(seen.size());  // squared distance, depth
  const std::size_t near = std::min(kAround, seen.size());
  for (std::size_t n = 0; n < kTries * count && out.positions.size() < count; ++n) {
    const Pixel at{random.uniform(first_draw + n, 0) * image.width,
                   random.uniform(first_draw + n, 1) * image.height};
    const std::size_t pixel = pixel_index(image, at);
    const Patch patch(picture, at);
    if (patch.plain() || (!image.mask.empty() && image.mask[pixel] == 0)) continue;
    std::ranges::transform(seen, around.begin(), [&](const SeenPoint& s) {
      const double x = s.at[0] - at[0], y = s.at[1] - at[1];
      return std::pair(x * x + y * y, s.depth);
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

// Returns the mean of the pixels around a corner, or -1 if some of them are outside of the image.
double brightness_at(const GreyPicture& picture, const Pixel& at) {
  constexpr int kReach = 2;
  double sum = 0;
  for (int y = -kReach; y <= kReach; ++y)
    for (int x = -kReach; x <= kReach; ++x) {
      const float value = picture.at(at[0] + x * picture.across, at[1] + y * picture.down);
      if (value < 0) return -1;
      sum += value;
    }
  return sum / ((2 * kReach + 1) * (2 * kReach + 1));
}

// Compares the brightness of two images at their matched corners. The ratio is how many times as bright the
// brighter image is in at least three quarters of the corners; the function returns its logarithm. Different
// exposures change the brightness of all corners by the same factor. Reflections change only some corners, so
// the ratio remains near 1. Returns nullopt if too few corners can be compared.
std::optional<double> log_brightness_ratio(const Corners& a, const Corners& b,
                                           const std::vector<Match>& matches) {
  std::vector<double> logs;
  for (const Match& match : matches) {
    const double in_a = brightness_at(a.picture, a.at[match.a]);
    const double in_b = brightness_at(b.picture, b.at[match.b]);
    if (std::min(in_a, in_b) >= kDarkest && std::max(in_a, in_b) <= kWhite)
      logs.push_back(std::log(in_b / in_a));
  }
  if (logs.size() < kMinCompared) return std::nullopt;
  std::ranges::sort(logs);
  return std::max({0.0, logs[logs.size() / 4], -logs[logs.size() - 1 - logs.size() / 4]});
}

}  // namespace

Triangulation triangulate(std::span<const View> all, std::size_t images, std::size_t between,
                          std::uint64_t seed) {
  std::vector<const View*> views;
  std::vector<Camera> cameras;
  const std::size_t count = std::min(images, all.size());
  for (std::size_t i = 0; i < count; ++i)
    if (const View& view = all[i * all.size() / count]; view.has_image())
      views.push_back(&view), cameras.push_back(view.camera);
  std::vector<Corners> corners(views.size());
  parallel_for(views.size(), [&](std::size_t v) { corners[v] = find_corners(*views[v], CornerKind::dense); });
  const auto pairs = neighbours(cameras, kNeighbours);
  std::vector<std::vector<Match>> matches(pairs.size());
  std::vector<std::optional<double>> ratios(pairs.size());
  parallel_for(pairs.size(), [&](std::size_t p) {
    const auto [a, b] = pairs[p];
    matches[p] = match(corners[a], corners[b]);
    ratios[p] = log_brightness_ratio(corners[a], corners[b], matches[p]);
  });

  std::vector<std::size_t> first(views.size() + 1);
  for (std::size_t v = 0; v < views.size(); ++v) first[v + 1] = first[v] + corners[v].at.size();
  Tracks tracks(first.back());
  for (std::size_t p = 0; p < pairs.size(); ++p)
    for (const Match& m : matches[p]) tracks.join(first[pairs[p].first] + m.a, first[pairs[p].second] + m.b);
  std::map<std::size_t, const Match*> points;  // the key is the track
  for (std::size_t p = 0; p < pairs.size(); ++p)
    for (const Match& m : matches[p]) {
      const auto [at, fresh] = points.try_emplace(tracks.of(first[pairs[p].first] + m.a), &m);
      if (!fresh && m.angle > at->second->angle) at->second = &m;
    }
  Triangulation out;
  for (const auto& [track, best] : points) add(out.points, best->point, best->colour.data());
  out.corners = points.size();

  std::erase(ratios, std::nullopt);
  if (ratios.size() >= kMinPairs) {
    const auto exceeded =
        ratios.begin() + static_cast<std::ptrdiff_t>(kExceeded * static_cast<double>(ratios.size() - 1));
    std::ranges::nth_element(ratios, exceeded);
    out.brightness_ratio = std::exp(**exceeded);
  }

  std::vector<std::vector<const GreyPicture*>> others(views.size());
  for (const auto& [a, b] : pairs) {
    others[a].push_back(&corners[b].picture);
    others[b].push_back(&corners[a].picture);
  }
  for (std::size_t v = 0; v < views.size(); ++v) {
    std::ranges::sort(others[v], {}, [&](const GreyPicture* other) {
      return length(other->camera.centre() - cameras[v].centre());
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
      const double depth = in_camera(cameras[v], point->second->point)[2];
      if (depth > 0) seen[v].push_back({corners[v].at[k], depth});
    }
  parallel_for(between > 0 ? views.size() : 0, [&](std::size_t v) {
    if (!seen[v].empty())
      place_between(*views[v], corners[v].picture, others[v], seen[v], share, random, v * kTries * share,
                    placed[v]);
  });
  for (const PointCloud& cloud : placed) {
    std::ranges::copy(cloud.positions, std::back_inserter(out.points.positions));
    std::ranges::copy(cloud.colours, std::back_inserter(out.points.colours));
  }
  return out;
}

}  // namespace ubs
