// SPDX-License-Identifier: Apache-2.0
#include "host/model/camera_path.hpp"

#include <algorithm>
#include <numbers>

#include "host/base/error.hpp"

namespace ubs {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;
// Maximum number of cameras that walk_path() visits. A path through more cameras would also follow the
// shaking of a hand-held camera.
constexpr std::size_t kWalkStations = 12;
// walk_path() keeps the order of the cameras if the path in this order is at most this many times as long as
// the path that always goes to the nearest remaining camera. The ratio is 1.0 to 1.3 for photographs taken
// while walking around an object, and at least 2 for random positions on a sphere.
constexpr double kDetour = 1.5;

bool whole(double loops) { return loops == std::round(loops); }

class Orbit : public CameraPath {
 public:
  Orbit(const SceneFrame& frame, double fov, double loops) : frame_(frame), fov_(fov), loops_(loops) {}

  Pose at(double u) const override {
    const double angle = kTurn * loops_ * u;
    const Vec3 side = cross(frame_.up, frame_.start);
    const Vec3 level = std::cos(angle) * frame_.start + std::sin(angle) * side;
    const Vec3 offset = std::cos(frame_.elevation) * level + std::sin(frame_.elevation) * frame_.up;
    Pose pose = look_at(frame_.centre + frame_.distance * offset, frame_.centre, frame_.up);
    pose.fov = fov_;
    return pose;
  }
  bool closed() const override { return whole(loops_); }

 private:
  SceneFrame frame_;
  double fov_, loops_;
};

class Spiral : public CameraPath {
 public:
  Spiral(const SceneFrame& frame, double fov, double loops)
      : frame_(frame),
        target_(frame.mean.position + frame.focus * frame.mean.forward()),
        fov_(fov),
        loops_(loops) {}

  Pose at(double u) const override {
    const double angle = kTurn * loops_ * u, s = frame_.spread;
    const Pose& mean = frame_.mean;
    const Vec3 position = mean.position + s * std::cos(angle) * mean.right() +
                          s * std::sin(angle) * mean.down() + s / 3 * std::sin(kTurn * u) * mean.forward();
    Pose pose = look_at(position, target_, -1.0 * mean.down());
    pose.fov = fov_;
    return pose;
  }
  bool closed() const override { return whole(loops_); }

 private:
  SceneFrame frame_;
  Vec3 target_;
  double fov_, loops_;
};

class Keyframes : public CameraPath {
 public:
  Keyframes(std::vector<Pose> keys, bool closed, bool has_time)
      : keys_(std::move(keys)), closed_(closed && keys_.size() > 1), has_time_(has_time) {
    if (keys_.empty()) fail(ErrorKind::usage, "a camera path needs at least one keyframe");
  }

  Pose at(double u) const override {
    const std::size_t n = keys_.size(), segments = closed_ ? n : n - 1;
    if (segments == 0) return keys_.front();
    const double x = std::clamp(u, 0.0, 1.0) * static_cast<double>(segments);
    const std::size_t i = std::min(static_cast<std::size_t>(x), segments - 1);
    const double s = x - static_cast<double>(i);
    const Pose &from = key(i), &to = key(i + 1);
    Pose pose;
    pose.position = position(i, s);
    pose.rotation = slerp(from.rotation, to.rotation, s);
    pose.fov = from.fov + s * (to.fov - from.fov);
    pose.time = from.time + s * (to.time - from.time);
    return pose;
  }
  bool closed() const override { return closed_; }
  bool has_time() const override { return has_time_; }

 private:
  const Pose& key(std::size_t i) const { return keys_[i % keys_.size()]; }

  // Interpolates the position in segment i. An open path is extended beyond each end by the mirror image of
  // the neighbouring keyframe, so that it starts and ends in a straight line.
  Vec3 position(std::size_t i, double s) const {
    const std::size_t n = keys_.size();
    const Vec3 p1 = key(i).position, p2 = key(i + 1).position;
    const Vec3 p0 = i > 0 || closed_ ? key(i + n - 1).position : 2.0 * p1 - p2;
    const Vec3 p3 = i + 2 < n || closed_ ? key(i + 2).position : 2.0 * p2 - p1;
    const Vec3 v1 = 0.5 * (p2 - p0), v2 = 0.5 * (p3 - p1);  // velocities at p1 and p2
    const double t = s * s * (3 - 2 * s);                   // the curve is a cubic Hermite spline
    return (1 - t) * p1 + t * p2 + s * (1 - s) * (1 - s) * v1 - s * s * (1 - s) * v2;
  }

  std::vector<Pose> keys_;
  bool closed_, has_time_;
};

}  // namespace

std::unique_ptr<CameraPath> orbit_path(const SceneFrame& frame, double fov, double loops) {
  return std::make_unique<Orbit>(frame, fov, loops);
}

std::unique_ptr<CameraPath> spiral_path(const SceneFrame& frame, double fov, double loops) {
  return std::make_unique<Spiral>(frame, fov, loops);
}

std::unique_ptr<CameraPath> keyframe_path(std::vector<Pose> keyframes, bool closed, bool has_time) {
  return std::make_unique<Keyframes>(std::move(keyframes), closed, has_time);
}

std::unique_ptr<CameraPath> walk_path(std::span<const Camera> cameras, double fov) {
  std::vector<Pose> given;
  for (const Camera& camera : evenly_chosen(cameras, kWalkStations)) given.push_back(pose_of(camera));
  for (Pose& pose : given) pose.fov = fov;
  const auto length_of = [](const std::vector<Pose>& poses) {
    double sum = 0;
    for (std::size_t i = 1; i < poses.size(); ++i) sum += length(poses[i].position - poses[i - 1].position);
    return sum;
  };
  std::vector<Pose> nearest = given;
  for (std::size_t i = 1; i < nearest.size(); ++i)
    std::iter_swap(nearest.begin() + static_cast<std::ptrdiff_t>(i),
                   std::ranges::min_element(
                       nearest.begin() + static_cast<std::ptrdiff_t>(i), nearest.end(), {},
                       [&](const Pose& pose) { return length(pose.position - nearest[i - 1].position); }));
  const bool walk = length_of(given) <= kDetour * length_of(nearest);
  return keyframe_path(walk ? std::move(given) : std::move(nearest), false, false);
}

std::vector<double> path_moments(int frames, bool closed) {
  std::vector<double> moments;
  const double last = closed ? frames : std::max(1, frames - 1);
  for (int i = 0; i < frames; ++i) moments.push_back(i / last);
  return moments;
}

}  // namespace ubs
