// SPDX-License-Identifier: Apache-2.0
#include "host/scene/camera_motion.hpp"

#include <cmath>

#include "host/scene/pose.hpp"

namespace ubs {
namespace {

struct Centres {
  Vec3 mean{};
  double spread = 0;  // sum of squared distances from the mean
};

Centres centres_of(std::span<const Camera> cameras) {
  Centres c;
  for (const Camera& camera : cameras) c.mean = c.mean + camera.centre();
  c.mean = (1 / static_cast<double>(cameras.size())) * c.mean;
  for (const Camera& camera : cameras) {
    const Vec3 away = camera.centre() - c.mean;
    c.spread += dot(away, away);
  }
  return c;
}

}  // namespace

RotationMatrix rotation_by(const Vec3& turn) {
  const double half = length(turn) / 2;
  const double s = half > 1e-9 ? std::sin(half) / (2 * half) : 0.5;
  return matrix(Quaternion{std::cos(half), s * turn[0], s * turn[1], s * turn[2]});
}

Vec3 turn_of(const RotationMatrix& rotation) {
  const Quaternion q = quaternion(rotation);
  const Vec3 v{q.x, q.y, q.z};
  const double sine = length(v);
  if (sine < 1e-12) return (q.w < 0 ? -2.0 : 2.0) * v;
  return (2 * std::atan2(q.w < 0 ? -sine : sine, std::abs(q.w)) / sine) * v;
}

Camera moved(const Camera& camera, const CameraMove& move, double depth) {
  Camera out = camera;
  const Vec3 pivot{0, 0, depth};
  const RotationMatrix turn = rotation_by({move[0], move[1], move[2]});
  out.rotation = product(turn, camera.rotation);
  out.translation =
      rotated(turn, Vec3(camera.translation) - pivot) + pivot + depth * Vec3{move[3], move[4], move[5]};
  out.fx *= std::exp(move[6]), out.fy *= std::exp(move[7]);
  out.cx += camera.fx * move[8], out.cy += camera.fy * move[9];
  return out;
}

CameraMove pose_move(const Camera& from, const Camera& to, double depth) {
  const RotationMatrix turn = product(to.rotation, transposed(from.rotation));
  const Vec3 pivot{0, 0, depth}, w = turn_of(turn);
  const Vec3 shift =
      (1 / depth) * (Vec3(to.translation) - pivot - rotated(turn, Vec3(from.translation) - pivot));
  return {w[0], w[1], w[2], shift[0], shift[1], shift[2]};
}

std::vector<Camera> moved_together(std::span<const Camera> given, std::span<const Camera> moved) {
  const double part = 1 / static_cast<double>(given.size());
  Vec3 turn{}, centre{};
  for (std::size_t i = 0; i < given.size(); ++i) {
    turn = turn + part * turn_of(product(transposed(given[i].rotation), moved[i].rotation));
    centre = centre + part * Vec3(moved[i].centre());
  }
  std::vector<Camera> together(given.begin(), given.end());
  for (Camera& camera : together) {
    camera.rotation = product(camera.rotation, rotation_by(turn));
    camera.translation = -1.0 * rotated(camera.rotation, centre);
  }
  return together;
}

void fix_similarity(std::vector<Camera>& cameras, std::span<const Camera> given) {
  Vec3 mean_turn{};
  for (std::size_t i = 0; i < cameras.size(); ++i)
    mean_turn = mean_turn + turn_of(product(transposed(cameras[i].rotation), given[i].rotation));
  const RotationMatrix back = rotation_by((-1 / static_cast<double>(cameras.size())) * mean_turn);
  const Centres now = centres_of(cameras), then = centres_of(given);
  // Cameras at the same or nearly the same position do not determine the scale.
  const bool spread = then.spread > 1e-12 * dot(then.mean, then.mean) && now.spread > 0;
  const double scale = spread ? std::sqrt(then.spread / now.spread) : 1;
  for (Camera& camera : cameras) {
    const Vec3 centre = scale * rotated(back, camera.centre() - now.mean) + then.mean;
    camera.rotation = product(camera.rotation, transposed(back));
    camera.translation = -1.0 * rotated(camera.rotation, centre);
  }
}

}  // namespace ubs
