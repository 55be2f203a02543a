// SPDX-License-Identifier: Apache-2.0
// See align_cameras.hpp. align_cameras() does a bundle adjustment with the Levenberg-Marquardt method, which
// moves all poses and all points together. Only a few cameras see each point, and only their poses appear in
// its equations. So each point is eliminated first (Schur complement), and the remaining equations contain
// only the poses.
#include "host/dataset/align_cameras.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "host/base/parallel.hpp"
#include "host/dataset/corners.hpp"
#include "host/scene/camera_motion.hpp"

namespace ubs {
namespace {

// Half width of the search band around an epipolar line in each of the four rounds, as a fraction of the
// width of the widest image.
constexpr std::array<double, 4> kBands{0.02, 0.008, 0.003, 0.003};
// [px] The Cauchy loss reduces the weight of residuals that are larger than this.
constexpr double kRobust = 1;
// [px] An observation whose error is larger than this after an adjustment is discarded.
constexpr double kMaxMatchError = 4;
// [rad] Assumed standard deviation of each of the six numbers that describe the error of a given pose. All of
// them are angles as seen in the image (camera_motion.hpp).
constexpr double kPriorAngle = 5e-3;
constexpr int kSteps = 30;
constexpr double kSettled = 1e-4;  // stop when a step lowers the cost by less than this fraction
// Each view is matched with kMatchedWith other views. A track must be observed in at least kMinSights views.
constexpr std::size_t kMatchedWith = 12, kMinSights = 3;
// A camera is aligned only if its image shows at least this many corners that belong to tracks.
constexpr std::size_t kMinSeen = 24;

using Row6 = cv::Matx<double, 2, 6>;
using Row3 = cv::Matx<double, 2, 3>;

struct Observation {  // one observation of a point
  std::size_t view;
  Pixel at;
};
struct Track {
  Vec3 point{};
  std::vector<Observation> seen;
};

// Triangulates the point of a track by least squares. Returns whether the point is in front of all cameras of
// the track.
bool place(Track& track, std::span<const Camera> cameras) {
  cv::Matx33d sum = cv::Matx33d::zeros();
  cv::Vec3d right(0, 0, 0);
  for (const Observation& s : track.seen) {
    const Vec3 d = cameras[s.view].ray(s.at[0], s.at[1]), c = cameras[s.view].centre();
    const double square = dot(d, d);
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) {
        const double m = (i == j) - d[static_cast<std::size_t>(i)] * d[static_cast<std::size_t>(j)] / square;
        sum(i, j) += m;
        right[i] += m * c[static_cast<std::size_t>(j)];
      }
  }
  bool solved = false;
  const cv::Matx33d inverse = sum.inv(cv::DECOMP_CHOLESKY, &solved);
  const cv::Vec3d x = inverse * right;
  track.point = {x[0], x[1], x[2]};
  return solved && std::ranges::all_of(track.seen, [&](const Observation& s) {
           return seen_at(cameras[s.view], track.point).has_value();
         });
}

class Adjustment {
 public:
  Adjustment(std::span<const Camera> given, std::vector<double> depths, std::vector<Track>& tracks)
      : given_(given), depths_(std::move(depths)), tracks_(tracks) {}

  void run(std::vector<Camera>& cameras) {
    if (tracks_.empty()) return;
    double damping = 1e-4, cost = cost_of(cameras, tracks_);
    for (int step = 0; step < kSteps && damping < 1e6; ++step) {
      std::vector<Camera> next = cameras;
      std::vector<Track> points = tracks_;
      const double after = move(next, points, damping) ? cost_of(next, points) : INFINITY;
      if (!(after < cost)) {
        damping *= 10;
        continue;
      }
      const bool settled = after > (1 - kSettled) * cost;
      cameras = std::move(next);
      tracks_ = std::move(points);
      cost = after;
      damping = std::max(1e-9, damping / 10);
      if (settled) break;
    }
  }

 private:
  double cost_of(std::span<const Camera> cameras, std::span<const Track> tracks) const {
    double cost = 0;
    for (const Track& track : tracks)
      for (const Observation& s : track.seen) {
        const auto at = seen_at(cameras[s.view], track.point);
        if (!at) return INFINITY;
        const double u = (*at)[0] - s.at[0], v = (*at)[1] - s.at[1];
        cost += kRobust * kRobust * std::log1p((u * u + v * v) / (kRobust * kRobust));
      }
    for (std::size_t i = 0; i < cameras.size(); ++i)
      for (const double angle : pose_move(cameras[i], given_[i], depths_[i]))
        cost += angle * angle / (kPriorAngle * kPriorAngle);
    return cost;
  }

  // Computes the derivatives of a pixel with respect to the six moves of its camera (camera_motion.hpp) and
  // with respect to its point. Returns false if the point is behind the camera.
  static bool linearise(const Camera& c, double depth, const Vec3& point, Pixel& at, Row6& by_pose,
                        Row3& by_point) {
    const Vec3 p = in_camera(c, point);
    if (!(p[2] > 0)) return false;
    at = {c.fx * p[0] / p[2] + c.cx, c.fy * p[1] / p[2] + c.cy};
    const Row3 lens(c.fx / p[2], 0, -c.fx * p[0] / (p[2] * p[2]), 0, c.fy / p[2],
                    -c.fy * p[1] / (p[2] * p[2]));
    const double z = p[2] - depth;  // depth relative to the pivot, which is at `depth` on the camera's axis
    const std::array<double, 18> motion{0, z,     -p[1], depth, 0,     0, -z, 0, p[0],
                                        0, depth, 0,     p[1],  -p[0], 0, 0,  0, depth};
    by_pose = lens * cv::Matx<double, 3, 6>(motion.data());
    by_point = lens * cv::Matx33d(c.rotation.data());
    return true;
  }

  bool move(std::vector<Camera>& cameras, std::vector<Track>& tracks, double damping) const {
    const int size = 6 * static_cast<int>(cameras.size());
    cv::Mat_<double> matrix(size, size, 0.0), right(size, 1, 0.0);
    // Adds the block of a pair of cameras to the upper half of the matrix.
    const auto block = [&](std::size_t i, std::size_t j, const cv::Matx66d& values) {
      for (int r = 0; r < 6; ++r) {
        double* const to = matrix[static_cast<int>(6 * i) + r] + 6 * j;
        for (int k = 0; k < 6; ++k) to[k] += values(r, k);
      }
    };
    const auto rows = [&](std::size_t i, const cv::Matx<double, 6, 1>& values) {
      for (int k = 0; k < 6; ++k) right(static_cast<int>(6 * i) + k, 0) += values(k);
    };
    struct Eliminated {
      cv::Matx33d inverse;
      cv::Vec3d right;
      std::vector<cv::Matx<double, 6, 3>> with_pose;
    };
    std::vector<Eliminated> points;
    for (const Track& track : tracks) {
      Eliminated e{cv::Matx33d::zeros(), {0, 0, 0}, {}};
      for (const Observation& s : track.seen) {
        Pixel at;
        Row6 by_pose;
        Row3 by_point;
        if (!linearise(cameras[s.view], depths_[s.view], track.point, at, by_pose, by_point)) return false;
        const cv::Vec2d residual(s.at[0] - at[0], s.at[1] - at[1]);
        const double weight = 1 / (1 + residual.dot(residual) / (kRobust * kRobust));
        block(s.view, s.view, weight * by_pose.t() * by_pose);
        rows(s.view, weight * by_pose.t() * residual);
        e.inverse += weight * by_point.t() * by_point;
        e.right += weight * by_point.t() * residual;
        e.with_pose.push_back(weight * by_pose.t() * by_point);
      }
      for (int k = 0; k < 3; ++k) e.inverse(k, k) *= 1 + damping;
      bool solved = false;
      e.inverse = e.inverse.inv(cv::DECOMP_CHOLESKY, &solved);
      if (!solved) return false;
      for (std::size_t a = 0; a < track.seen.size(); ++a) {
        const cv::Matx<double, 6, 3> left = e.with_pose[a] * e.inverse;
        rows(track.seen[a].view, -1.0 * (left * e.right));
        for (std::size_t b = a; b < track.seen.size(); ++b)
          block(track.seen[a].view, track.seen[b].view, -1.0 * left * e.with_pose[b].t());
      }
      points.push_back(std::move(e));
    }
    for (std::size_t i = 0; i < cameras.size(); ++i) {
      const CameraMove back = pose_move(cameras[i], given_[i], depths_[i]);
      for (std::size_t k = 0; k < kPoseMoves; ++k) {
        const int at = static_cast<int>(6 * i + k);
        const double held = 1 / (kPriorAngle * kPriorAngle);
        matrix(at, at) = (matrix(at, at) + held) * (1 + damping);
        right(at, 0) += held * back[k];
      }
    }
    cv::completeSymm(matrix);
    cv::Mat_<double> found;
    if (!cv::solve(matrix, right, found, cv::DECOMP_CHOLESKY)) return false;
    for (std::size_t i = 0; i < cameras.size(); ++i) {
      CameraMove pose{};
      for (std::size_t k = 0; k < kPoseMoves; ++k) pose[k] = found(static_cast<int>(6 * i + k), 0);
      cameras[i] = moved(cameras[i], pose, depths_[i]);
    }
    for (std::size_t t = 0; t < tracks.size(); ++t) {
      cv::Vec3d pull = points[t].right;
      for (std::size_t a = 0; a < tracks[t].seen.size(); ++a) {
        const int first = 6 * static_cast<int>(tracks[t].seen[a].view);
        cv::Matx<double, 6, 1> pose;
        for (int k = 0; k < 6; ++k) pose(k) = found(first + k, 0);
        pull -= points[t].with_pose[a].t() * pose;
      }
      const cv::Vec3d step = points[t].inverse * pull;
      for (std::size_t k = 0; k < 3; ++k) tracks[t].point[k] += step[static_cast<int>(k)];
    }
    return true;
  }

  std::span<const Camera> given_;
  std::vector<double> depths_;
  std::vector<Track>& tracks_;
};

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::ranges::nth_element(values, middle);
  return *middle;
}

double error_of(const Camera& camera, const Track& track, const Observation& sight) {
  const auto at = seen_at(camera, track.point);
  return at ? std::hypot((*at)[0] - sight.at[0], (*at)[1] - sight.at[1]) : INFINITY;
}

double median_error(std::span<const Camera> cameras, std::span<const Track> tracks) {
  std::vector<double> errors;
  for (const Track& track : tracks)
    for (const Observation& s : track.seen) errors.push_back(error_of(cameras[s.view], track, s));
  return median(std::move(errors));
}

void adjust(std::span<const Camera> given, std::vector<Track>& tracks, std::vector<Camera>& cameras) {
  std::vector<std::vector<double>> depths(cameras.size());
  for (const Track& track : tracks)
    for (const Observation& s : track.seen)
      depths[s.view].push_back(in_camera(cameras[s.view], track.point)[2]);
  std::vector<double> pivots;
  for (auto& of_view : depths) pivots.push_back(of_view.empty() ? 1 : median(std::move(of_view)));
  Adjustment(given, std::move(pivots), tracks).run(cameras);
}

void take_camera(Corners& corners, const Camera& camera) {
  corners.picture.camera = camera;
  for (std::size_t k = 0; k < corners.at.size(); ++k)
    corners.rays[k] = camera.ray(corners.at[k][0], corners.at[k][1]);
}

std::vector<Track> find_tracks(std::span<const Corners> corners,
                               std::span<const std::pair<std::size_t, std::size_t>> pairs, double band,
                               std::span<const Camera> cameras) {
  std::vector<std::vector<std::pair<std::size_t, std::size_t>>> matches(pairs.size());
  parallel_for(pairs.size(), [&](std::size_t p) {
    const Corners &a = corners[pairs[p].first], &b = corners[pairs[p].second];
    const auto there = best_along_lines(a, b, band), back = best_along_lines(b, a, band);
    for (std::size_t i = 0; i < there.size(); ++i)
      if (there[i] >= 0 && back[static_cast<std::size_t>(there[i])] == static_cast<std::ptrdiff_t>(i))
        matches[p].emplace_back(i, static_cast<std::size_t>(there[i]));
  });
  std::vector<std::size_t> first(corners.size() + 1);
  for (std::size_t v = 0; v < corners.size(); ++v) first[v + 1] = first[v] + corners[v].at.size();
  Tracks joined(first.back());
  for (std::size_t p = 0; p < pairs.size(); ++p)
    for (const auto& [a, b] : matches[p]) joined.join(first[pairs[p].first] + a, first[pairs[p].second] + b);
  std::map<std::size_t, Track> found;
  for (std::size_t v = 0; v < corners.size(); ++v)
    for (std::size_t k = 0; k < corners[v].at.size(); ++k)
      found[joined.of(first[v] + k)].seen.push_back({v, corners[v].at[k]});
  std::vector<Track> tracks;
  for (auto& [root, track] : found) {
    // A track with two corners in the same image contains a wrong match, so it is not used.
    const auto same = std::ranges::adjacent_find(track.seen, {}, &Observation::view);
    if (track.seen.size() >= kMinSights && same == track.seen.end() && place(track, cameras))
      tracks.push_back(std::move(track));
  }
  return tracks;
}

}  // namespace

Alignment align_cameras(std::span<const View> views) {
  Alignment out;
  for (const View& view : views) out.cameras.push_back(view.camera);
  if (views.size() > kMaxAlignedViews) return out;
  const std::vector<Camera> given = out.cameras;
  std::vector<Corners> corners(views.size());
  parallel_for(views.size(),
               [&](std::size_t v) { corners[v] = find_corners(views[v], CornerKind::distinct); });
  const auto pairs = neighbours(given, kMatchedWith);
  int widest = 0;
  for (const Corners& of_view : corners) widest = std::max(widest, of_view.picture.width);
  std::vector<Track> tracks;
  for (const double share : kBands) {
    for (std::size_t v = 0; v < views.size(); ++v) take_camera(corners[v], out.cameras[v]);
    tracks = find_tracks(corners, pairs, share * widest, out.cameras);
    if (share == kBands.front()) out.before = median_error(given, tracks);
    adjust(given, tracks, out.cameras);
    for (Track& track : tracks)
      std::erase_if(track.seen, [&](const Observation& s) {
        return error_of(out.cameras[s.view], track, s) > kMaxMatchError;
      });
    std::erase_if(tracks, [](const Track& track) { return track.seen.size() < kMinSights; });
    adjust(given, tracks, out.cameras);
  }
  out.points = tracks.size();
  out.after = median_error(out.cameras, tracks);
  std::vector<std::size_t> seen(views.size());
  for (const Track& track : tracks)
    for (const Observation& s : track.seen) ++seen[s.view];
  fix_similarity(out.cameras, given);
  for (std::size_t v = 0; v < views.size(); ++v)
    if (seen[v] >= kMinSeen)
      ++out.aligned;
    else
      out.cameras[v] = given[v];
  if (2 * out.aligned < views.size() || !(out.after < out.before)) {
    out.cameras = given;
    out.aligned = 0;
  }
  return out;
}

}  // namespace ubs
