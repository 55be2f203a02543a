// SPDX-License-Identifier: Apache-2.0
// Defines a renderer of 3D Gaussian Splatting in double precision. It is implemented from the published
// definition of the method and of the columns of its files, and uses no formulas, kernels or readers of ubs.
// It evaluates every splat at every pixel and skips contributions with an alpha below 1/255.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "host/scene/camera.hpp"

namespace ubs::oracle {

// The columns of a 3DGS file in the order of the file.
struct FileGaussian {
  std::array<float, 3> position, log_scale;
  std::array<float, 4> rotation;  // w x y z, of any length
  float opacity;                  // logit
  std::array<float, 3> f_dc;
  std::array<float, 45> f_rest;  // 15 coefficients for red, then 15 for green and 15 for blue
};

struct GaussianImage {
  std::vector<double> rgb;  // (height, width, 3)
  // (height, width): true if at this pixel, the alpha of a splat or the transmittance is within 0.1 % of a
  // threshold, so that single precision may decide differently.
  std::vector<bool> knife_edge;
};

// Returns the real spherical harmonic with the number k = l l + l + m in the direction (theta, phi). It is
// computed from the associated Legendre functions: sqrt 2 |Y_lm| cos(m phi) for m > 0, and sqrt 2 |Y_lm|
// sin(|m| phi) for m < 0. 3DGS uses the Condon-Shortley phase, which std::sph_legendre includes.
inline double real_harmonic(int k, double theta, double phi) {
  const int l = static_cast<int>(std::sqrt(k)), m = k - l * l - l;
  const double y = std::sph_legendre(static_cast<unsigned>(l), static_cast<unsigned>(std::abs(m)), theta);
  return m == 0 ? y : std::numbers::sqrt2 * y * (m > 0 ? std::cos(m * phi) : std::sin(-m * phi));
}

namespace gaussian_detail {

struct Footprint {
  // (x, y) is the position in the image [pixels]. At the offset (dx, dy) from it, alpha is the opacity times
  // exp(-(a dx dx + 2 b dx dy + c dy dy) / 2).
  double depth, x, y, a, b, c, opacity;
  std::array<double, 3> colour;
};

inline std::array<double, 3> turned(const std::array<double, 9>& r, const std::array<double, 3>& v) {
  return {r[0] * v[0] + r[1] * v[1] + r[2] * v[2], r[3] * v[0] + r[4] * v[1] + r[5] * v[2],
          r[6] * v[0] + r[7] * v[1] + r[8] * v[2]};
}

// Returns q v q*, computed by quaternion products.
inline std::array<double, 3> rotated(std::array<double, 4> q, const std::array<double, 3>& v) {
  const double n = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  for (double& e : q) e /= n;
  const auto times = [](const std::array<double, 4>& p, const std::array<double, 4>& s) {
    return std::array<double, 4>{p[0] * s[0] - p[1] * s[1] - p[2] * s[2] - p[3] * s[3],
                                 p[0] * s[1] + p[1] * s[0] + p[2] * s[3] - p[3] * s[2],
                                 p[0] * s[2] - p[1] * s[3] + p[2] * s[0] + p[3] * s[1],
                                 p[0] * s[3] + p[1] * s[2] - p[2] * s[1] + p[3] * s[0]};
  };
  const auto out = times(times(q, {0, v[0], v[1], v[2]}), {q[0], -q[1], -q[2], -q[3]});
  return {out[1], out[2], out[3]};
}

// Projects a Gaussian to the image.
inline Footprint footprint(const FileGaussian& g, const Camera& camera) {
  std::array<double, 3> p = turned(camera.rotation, {g.position[0], g.position[1], g.position[2]});
  for (std::size_t k = 0; k < 3; ++k) p[k] += camera.translation[k];
  Footprint f{};
  f.depth = p[2];
  f.x = camera.fx * p[0] / p[2] + camera.cx;
  f.y = camera.fy * p[1] / p[2] + camera.cy;
  f.opacity = 1 / (1 + std::exp(-static_cast<double>(g.opacity)));

  // Projects each axis of the ellipsoid with the linearised projection, and sums their outer products.
  double xx = 0.3, xy = 0, yy = 0.3;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    std::array<double, 3> v{};
    v[axis] = std::exp(static_cast<double>(g.log_scale[axis]));
    v = turned(camera.rotation, rotated({g.rotation[0], g.rotation[1], g.rotation[2], g.rotation[3]}, v));
    const double sx =
        std::clamp(p[0] / p[2], -1.3 * camera.width / 2 / camera.fx, 1.3 * camera.width / 2 / camera.fx);
    const double sy =
        std::clamp(p[1] / p[2], -1.3 * camera.height / 2 / camera.fy, 1.3 * camera.height / 2 / camera.fy);
    const double ix = camera.fx / p[2] * (v[0] - sx * v[2]), iy = camera.fy / p[2] * (v[1] - sy * v[2]);
    xx += ix * ix, xy += ix * iy, yy += iy * iy;
  }
  const double det = xx * yy - xy * xy;
  f.a = yy / det, f.b = -xy / det, f.c = xx / det;

  const std::array<double, 3> eye = camera.centre();
  const double dx = g.position[0] - eye[0], dy = g.position[1] - eye[1], dz = g.position[2] - eye[2];
  const double theta = std::acos(dz / std::sqrt(dx * dx + dy * dy + dz * dz)), phi = std::atan2(dy, dx);
  for (std::size_t c = 0; c < 3; ++c) {
    double sum = 0.5 + g.f_dc[c] * real_harmonic(0, theta, phi);
    for (std::size_t k = 1; k < 16; ++k)
      sum += g.f_rest[15 * c + k - 1] * real_harmonic(static_cast<int>(k), theta, phi);
    f.colour[c] = std::max(0.0, sum);
  }
  return f;
}

}  // namespace gaussian_detail

// Renders the Gaussians whose centre is not closer than the near plane.
inline GaussianImage render_gaussians(const std::vector<FileGaussian>& gaussians, const Camera& camera,
                                      const std::array<double, 3>& background, double near_plane) {
  std::vector<gaussian_detail::Footprint> drawn;
  for (const FileGaussian& g : gaussians) {
    const gaussian_detail::Footprint f = gaussian_detail::footprint(g, camera);
    if (f.depth >= near_plane) drawn.push_back(f);
  }
  std::ranges::stable_sort(drawn, {}, &gaussian_detail::Footprint::depth);
  const std::size_t pixels = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  GaussianImage out{std::vector<double>(3 * pixels), std::vector<bool>(pixels)};
  for (std::size_t i = 0; i < pixels; ++i) {
    const double px = static_cast<double>(i % static_cast<std::size_t>(camera.width)) + 0.5;
    const double py = static_cast<double>(i / static_cast<std::size_t>(camera.width)) + 0.5;
    double light = 1;
    const auto near = [&](double value, double cut) {
      if (std::abs(value / cut - 1) < 1e-3) out.knife_edge[i] = true;
    };
    for (const auto& f : drawn) {
      const double dx = px - f.x, dy = py - f.y;
      const double square = f.a * dx * dx + 2 * f.b * dx * dy + f.c * dy * dy;
      const double alpha = std::min(0.99, f.opacity * std::exp(-square / 2));
      near(alpha, 1.0 / 255);
      if (alpha < 1.0 / 255) continue;
      near(light * (1 - alpha), 1e-4);
      if (light * (1 - alpha) < 1e-4) break;
      for (std::size_t c = 0; c < 3; ++c) out.rgb[3 * i + c] += light * alpha * f.colour[c];
      light *= 1 - alpha;
    }
    for (std::size_t c = 0; c < 3; ++c) out.rgb[3 * i + c] += light * background[c];
  }
  return out;
}

}  // namespace ubs::oracle
