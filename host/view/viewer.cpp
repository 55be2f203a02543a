// SPDX-License-Identifier: Apache-2.0
#include "host/view/viewer.hpp"

#include <algorithm>
#include <cctype>
#include <numbers>
#include <utility>

namespace ubs {
namespace {

constexpr double kStep = 0.05;                  // of the distance to the pivot, per key
constexpr double kWheel = 0.9;                  // of the distance remains, per step
constexpr double kPlaySeconds = 4;              // for times from 0 to 1
constexpr double kPole = 0.05;                  // rad that the view stays away from straight up and down
constexpr double kDragTurn = std::numbers::pi;  // rad, for a drag across the picture

// Rodrigues: `v` turned around the unit vector `axis`.
Vec3 turned(const Vec3& v, const Vec3& axis, double angle) {
  return std::cos(angle) * v + std::sin(angle) * cross(axis, v) + (1 - std::cos(angle)) * dot(axis, v) * axis;
}

Pose turned(const Pose& pose, const Vec3& pivot, const Vec3& axis, double angle) {
  const Vec3 right = turned(pose.right(), axis, angle), down = turned(pose.down(), axis, angle),
             forward = turned(pose.forward(), axis, angle);
  Pose result = pose;
  result.position = pivot + turned(pose.position - pivot, axis, angle);
  result.rotation = quaternion(
      {right[0], right[1], right[2], down[0], down[1], down[2], forward[0], forward[1], forward[2]});
  return result;
}

double clamp01(double v) { return std::clamp(v, 0.0, 1.0); }

}  // namespace

Viewer::Viewer(ViewerScene scene, int width, int height)
    : scene_(std::move(scene)), canvas_{width, height, {}} {
  canvas_.extra = scene_.frame.extra;
  reset();
}

void Viewer::reset() {
  if (!scene_.views.empty()) return go_to(0);
  const double time = pose_.time;
  at_view_ = -1;
  pose_ = orbit_start(scene_.frame);
  pose_.fov = scene_.fov;
  pose_.time = time;
  pivot_ = scene_.frame.centre;
  ++changes_;
}

// Turns around the depth of the scene's middle, or what is in front of the camera where that lies behind.
void Viewer::go_to(std::size_t index) {
  const Camera& view = scene_.views[index];
  at_view_ = static_cast<int>(index);
  pose_ = pose_of(view);
  pose_.fov = fov_showing(view, canvas_);
  canvas_.extra = view.extra;
  const double middle = dot(scene_.frame.centre - pose_.position, pose_.forward());
  pivot_ = pose_.position + std::max(middle, 0.1 * scene_.frame.distance) * pose_.forward();
  ++changes_;
}

double Viewer::depth() const {
  return std::max(length(pivot_ - pose_.position), 1e-6 * scene_.frame.distance);
}

void Viewer::orbit(double yaw, double pitch) {
  const Vec3& up = scene_.frame.up;
  at_view_ = -1;
  pose_ = turned(pose_, pivot_, up, yaw);
  const Pose tilted = turned(pose_, pivot_, pose_.right(), pitch);
  const double before = std::abs(dot(pose_.forward(), up)), after = std::abs(dot(tilted.forward(), up));
  if (after < std::cos(kPole) || after < before) pose_ = tilted;
  ++changes_;
}

void Viewer::shift(double right, double down, double forward) {
  at_view_ = -1;
  const Vec3 way = right * pose_.right() + down * pose_.down() + forward * pose_.forward();
  pose_.position = pose_.position + way;
  pivot_ = pivot_ + way;
  ++changes_;
}

void Viewer::dolly(double factor) {
  at_view_ = -1;
  const double least = 1e-3 * scene_.frame.distance;
  pose_.position = pivot_ + std::max(factor, least / depth()) * (pose_.position - pivot_);
  ++changes_;
}

void Viewer::key(char key) {
  const double step = kStep * std::max(depth(), 0.2 * scene_.frame.distance);
  switch (std::tolower(static_cast<unsigned char>(key))) {
    case 'w':
      return shift(0, 0, step);
    case 's':
      return shift(0, 0, -step);
    case 'a':
      return shift(-step, 0, 0);
    case 'd':
      return shift(step, 0, 0);
    case 'q':
      return shift(0, step, 0);
    case 'e':
      return shift(0, -step, 0);
    case '+':
      return dolly(kWheel);
    case '-':
      return dolly(1 / kWheel);
    case 'r':
      return reset();
    case 'm':
      channel_ = static_cast<Channel>((static_cast<int>(channel_) + 1) % 3);
      ++changes_;
      return;
    case 'n':
      if (!scene_.views.empty()) go_to(static_cast<std::size_t>(at_view_ + 1) % scene_.views.size());
      return;
    case 'g':
      truth_ = !truth_;
      ++changes_;
      return;
    case 'h':
      help_ = !help_;
      return;
    case 'o':
      overlay_ = !overlay_;
      return;
    case 'p':
      orders_.push_back(Order::save_picture);
      return;
    case 'k':
      keyframes_.push_back(pose_);
      orders_.push_back(Order::save_keyframes);
      return;
    case ' ':
      playing_ = scene_.has_time && !playing_;
      return;
    case 27:
      return quit();
    default:
      break;
  }
  const std::size_t view = static_cast<std::size_t>(key - '1');
  if (key >= '1' && key <= '9' && view < scene_.views.size()) go_to(view);
}

void Viewer::press(Drag drag, double x, double y) {
  drag_ = drag;
  x_ = x;
  y_ = y;
}

void Viewer::move(double x, double y) {
  const double dx = x - x_, dy = y - y_;
  x_ = x;
  y_ = y;
  if (drag_ == Drag::none || (dx == 0 && dy == 0)) return;
  // The scene follows the mouse: the camera goes the other way.
  const double per_pixel = 2 * std::tan(pose_.fov / 2) / canvas_.width * depth();
  if (drag_ == Drag::orbit) orbit(-kDragTurn * dx / canvas_.width, -kDragTurn * dy / canvas_.height);
  if (drag_ == Drag::pan) shift(-dx * per_pixel, -dy * per_pixel, 0);
  if (drag_ == Drag::dolly) dolly(std::exp(3 * dy / canvas_.height));
}

void Viewer::wheel(double steps) { dolly(std::pow(kWheel, steps)); }

void Viewer::set_time(double time) {
  if (clamp01(time) == pose_.time) return;
  pose_.time = clamp01(time);
  ++changes_;
}

void Viewer::set_beta_low(BetaKind kind, double low) {
  set_beta(kind, {clamp01(low), std::max(beta(kind).high, clamp01(low))});
}
void Viewer::set_beta_high(BetaKind kind, double high) {
  set_beta(kind, {std::min(beta(kind).low, clamp01(high)), clamp01(high)});
}

void Viewer::set_beta(BetaKind kind, const BetaRange& range) {
  BetaRange& now = betas_[static_cast<std::size_t>(kind)];
  if (range.low == now.low && range.high == now.high) return;
  now = range;
  ++changes_;
  ++choices_;
}

void Viewer::resize(int width, int height) {
  if (width == canvas_.width && height == canvas_.height) return;
  canvas_.width = std::max(16, width);
  canvas_.height = std::max(16, height);
  ++changes_;
}

void Viewer::advance(double seconds) {
  if (!playing_) return;
  const double time = pose_.time + seconds / kPlaySeconds;
  set_time(time - std::floor(time));
}

Camera Viewer::camera() const { return camera_at(pose_, canvas_); }

std::vector<Order> Viewer::take_orders() { return std::exchange(orders_, {}); }

std::vector<std::string> viewer_help(const ViewerScene& scene) {
  std::vector<std::string> lines{
      "left drag\tturn around the scene", "right drag\tshift (also shift + left drag)",
      "wheel, +, -\tnearer, farther (also ctrl + drag)", "W S A D Q E\tfly", "R\treset"};
  if (!scene.views.empty())
    lines.insert(lines.end(),
                 {"1 to 9, N\tviews of the data, the next one", "G\tits photograph beside the picture"});
  if (scene.has_time) lines.push_back("space\tplay time");
  for (const char* line : {"M\tcolour, alpha, depth", "P\tsave the picture", "K\tadd a keyframe and save all",
                           "O\tthese figures on, off", "H\tthis help", "Esc\tquit"})
    lines.push_back(line);
  return lines;
}

// Time is taken to grow with the pixels; half of the correction at a time, since it grows more slowly.
void AdaptiveScale::measured(double scale, double seconds) {
  if (!(seconds > 0)) return;
  const double wanted = scale * std::sqrt(kTarget / seconds);
  scale_ = std::clamp(std::sqrt(scale * wanted), 1.0 / 16, 1.0);
}

}  // namespace ubs
