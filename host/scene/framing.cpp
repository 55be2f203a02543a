// SPDX-License-Identifier: Apache-2.0
// See framing.hpp.
#include "host/scene/framing.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>
#include <tuple>

#include "host/base/error.hpp"

namespace ubs {
namespace {

using Vector = std::array<double, 3>;

constexpr double kFieldOfView = 0.87;
constexpr double kMargin = 1.2;    // a tenth of the opacity lies outside of the radius
constexpr double kFloorRatio = 3;  // lego on its plate: 5; a standing figure, a street: below 2

struct Weighted {
  double value, weight;
};

// Values at the given shares (rising) of the weight.
std::vector<double> quantiles(std::vector<Weighted> values, std::span<const double> shares) {
  std::ranges::sort(values, {}, &Weighted::value);
  double total = 0, sum = 0;
  for (const Weighted& v : values) total += v.weight;
  std::vector<double> out;
  for (const Weighted& v : values) {
    sum += v.weight;
    while (out.size() < shares.size() && sum >= shares[out.size()] * total) out.push_back(v.value);
  }
  while (out.size() < shares.size()) out.push_back(values.empty() ? 0 : values.back().value);
  return out;
}

template <typename Value>
std::vector<Weighted> weighted(const MixedModel& model, const Value& value) {
  std::vector<Weighted> out;
  for (const SplatModel& group : model.groups) {
    const ParameterLayout l = group.layout();
    for (std::size_t i = 0; i < group.count; ++i)
      out.push_back({value(Vector{group.row(l.xyz)[i], group.row(l.xyz + 1)[i], group.row(l.xyz + 2)[i]}),
                     1 / (1 + std::exp(-static_cast<double>(group.row(l.opacity)[i])))});
  }
  return out;
}

Vector cross(const Vector& a, const Vector& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

Vector unit(const Vector& v) {
  const double n = std::hypot(v[0], v[1], v[2]);
  return {v[0] / n, v[1] / n, v[2] / n};
}

}  // namespace

Vector guess_up(const MixedModel& model, const Vector& otherwise) {
  constexpr double kShares[] = {0.01, 0.25, 0.75, 0.99};
  double most = kFloorRatio;
  Vector up = otherwise;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto q = quantiles(weighted(model, [axis](const Vector& p) { return p[axis]; }), kShares);
    const double low = q[1] - q[0], high = q[3] - q[2];
    for (const auto& [thin, thick, sign] : {std::tuple(low, high, 1.0), std::tuple(high, low, -1.0)}) {
      if (!(thick > most * thin) || !(thick > 0)) continue;
      most = thin > 0 ? thick / thin : HUGE_VAL;
      up = {};
      up[axis] = sign;
    }
  }
  return up;
}

Framing frame_model(const MixedModel& model, const Vector& up) {
  if (model.count() == 0) fail(ErrorKind::data, "the model has no splats to look at");
  Framing framing;
  framing.up = unit(up);
  constexpr double kHalf[] = {0.5}, kMost[] = {0.9};
  for (std::size_t axis = 0; axis < 3; ++axis)
    framing.centre[axis] = quantiles(weighted(model, [axis](const Vector& p) { return p[axis]; }), kHalf)[0];
  const Vector& c = framing.centre;
  const auto distance = [&c](const Vector& p) { return std::hypot(p[0] - c[0], p[1] - c[1], p[2] - c[2]); };
  framing.radius = quantiles(weighted(model, distance), kMost)[0];
  if (!(framing.radius > 0)) framing.radius = 1;
  return framing;
}

Vector parse_axis(std::string_view text) {
  const bool negative = text.starts_with('-');
  const std::string_view name = text.substr(negative ? 1 : 0);
  if (name.size() != 1 || name[0] < 'x' || name[0] > 'z')
    fail(ErrorKind::usage, "axis '{}': choose x, y, z, -x, -y or -z", text);
  Vector axis{};
  axis[static_cast<std::size_t>(name[0] - 'x')] = negative ? -1 : 1;
  return axis;
}

std::vector<Camera> framing_cameras(const Framing& f, std::size_t count, int width, int height,
                                    double elevation) {
  const Vector side = unit(cross(f.up, std::abs(f.up[0]) < 0.6 ? Vector{1, 0, 0} : Vector{0, 1, 0}));
  const Vector front = cross(side, f.up);
  const double focal = width / (2 * std::tan(kFieldOfView / 2));
  const double narrow = std::atan(std::min(width, height) / (2 * focal));
  const double distance = kMargin * f.radius / std::sin(narrow);
  std::vector<Camera> cameras;
  for (std::size_t i = 0; i < count; ++i) {
    const double azimuth = 2 * std::numbers::pi * static_cast<double>(i) / static_cast<double>(count);
    Vector back{};  // from the centre to the camera
    for (std::size_t k = 0; k < 3; ++k)
      back[k] = std::cos(elevation) * (std::cos(azimuth) * front[k] + std::sin(azimuth) * side[k]) +
                std::sin(elevation) * f.up[k];
    const Vector forward{-back[0], -back[1], -back[2]}, right = unit(cross(forward, f.up));
    const Vector down = cross(forward, right);
    Camera camera;
    for (std::size_t k = 0; k < 3; ++k) {
      camera.rotation[k] = right[k], camera.rotation[3 + k] = down[k], camera.rotation[6 + k] = forward[k];
      const double position = f.centre[k] + distance * back[k];
      camera.translation[0] -= right[k] * position;
      camera.translation[1] -= down[k] * position;
      camera.translation[2] -= forward[k] * position;
    }
    camera.fx = camera.fy = focal;
    camera.cx = 0.5 * width, camera.cy = 0.5 * height;
    camera.width = width, camera.height = height;
    cameras.push_back(camera);
  }
  return cameras;
}

}  // namespace ubs
