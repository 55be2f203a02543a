// SPDX-License-Identifier: Apache-2.0
// Compares the gradient of compositing a few splats at a pixel (the vector-Jacobian product, VJP, of
// kernels/math/blend.h) in double precision with central differences. This file is compiled once for each
// spatial kernel (UBS_FALLOFF), and once with a minimum alpha. CMake defines UBS_TEST_FORM, the name of the
// form.
#define UBS_TEST_NAME(text) text ", " UBS_TEST_FORM

#include <array>
#include <catch2/catch.hpp>
#include <random>
#include <vector>

#include "tests/math/shared_math.hpp"

namespace {

// A splat has the values x, y (mean minus pixel centre), Q00, Q01, Q11 (conic), opacity, beta, r, g, b.
constexpr std::size_t kValues = 10;
using Splat = std::array<double, kValues>;
using Colour = std::array<double, 3>;

BlendSplat blend_splat(const Splat& s) {
  const double l00 = std::sqrt(s[2]), l01 = s[3] / l00;
  return {l00, l01, std::sqrt(s[4] - l01 * l01), s[5], s[6], s[7], s[8], s[9]};
}

constexpr Colour kBackground{0.2, 0.5, 0.1}, kWeights{0.7, -1.3, 0.4};

double loss(const std::vector<Splat>& splats) {
  double open = 1, sum = 0;
  for (const Splat& values : splats) {
    const BlendSplat s = blend_splat(values);
    const BlendStep step = blend_step(blend_alpha(s, values[0], values[1]), open);
    sum += step.weight * (s.r * kWeights[0] + s.g * kWeights[1] + s.b * kWeights[2]);
    open = step.open;
  }
  for (std::size_t c = 0; c < 3; ++c) sum += open * kBackground[c] * kWeights[c];
  return sum;
}

using Conic = std::array<double, 3>;

// Returns the entries 00, 01 and 11 of v_Q, the gradient of the conic Q = L^T L. It is -L^-1 W L^-T, where W
// is the symmetric matrix with the entries w00, w01 and w11 (method.md 3.2).
Conic conic_gradient(const BlendSplat& l, double w00, double w01, double w11) {
  const double a = 1 / l.l00, b = -l.l01 / (l.l00 * l.l11), c = 1 / l.l11;  // L^-1 = [[a, b], [0, c]]
  return {-(a * a * w00 + 2 * a * b * w01 + b * b * w11), -(a * c * w01 + b * c * w11), -c * c * w11};
}

std::vector<Splat> gradient(const std::vector<Splat>& splats) {
  double open = 1, remaining = loss(splats);
  std::vector<Splat> out;
  for (const Splat& values : splats) {
    const BlendSplat s = blend_splat(values);
    const BlendAlpha a = blend_alpha(s, values[0], values[1]);
    const BlendStep step = blend_step(a, open);
    const double shade = blend_shade(s, kWeights[0], kWeights[1], kWeights[2]);
    remaining = blend_remaining(step, remaining, shade);
    const BlendSums v =
        blend_vjp(blend_no_sums(), s, a, step, open, remaining, shade, kWeights[0], kWeights[1], kWeights[2]);
    const BlendFactors f = blend_factors(s);
    const Conic q = conic_gradient(s, f.square * v.hpp, f.square * v.hpq, f.square * v.hqq);
    out.push_back({f.xp * v.hp, f.yp * v.hp + f.yq * v.hq, q[0], 2 * q[1], q[2], v.opacity,
                   UBS_LN2 * v.log_beta, v.r, v.g, v.b});
    open = step.open;
  }
  return out;
}

}  // namespace

TEST_CASE(UBS_TEST_NAME("blend VJP agrees with central differences"), "[math][variants]") {
  std::mt19937_64 g(11);
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(g() >> 11) * 0x1p-53;
  };
  double worst = 0;
  int reached = 0;
  for (int pixel = 0; pixel < 200; ++pixel) {
    std::vector<Splat> splats;
    for (int k = 0; k < 4; ++k) {
      const double q00 = uniform(0.2, 1), q11 = uniform(0.2, 1);
      const double reach = std::sqrt(UBS_SUPPORT);
      splats.push_back({reach * uniform(-0.9, 0.9), reach * uniform(-0.9, 0.9), q00,
                        0.5 * std::sqrt(q00 * q11) * uniform(-1, 1), q11, uniform(0.1, 0.9), uniform(0.5, 5),
                        uniform(0, 1), uniform(0, 1), uniform(0, 1)});
    }
    const std::vector<Splat> analytic = gradient(splats);
    double error = 0, norm = 0;
    for (std::size_t k = 0; k < splats.size(); ++k) {
      // The steps of the differences must not cross the end of the support or the minimum alpha, where the
      // derivatives jump. Therefore splats near these limits are skipped. A minimum of 1/255 is assumed for
      // all kernels, so that all builds of this file test the same pixels.
      const BlendAlpha a = blend_alpha(blend_splat(splats[k]), splats[k][0], splats[k][1]);
      if (std::abs(a.r - UBS_SUPPORT) < 1e-2 || std::abs(splats[k][5] * a.falloff * 255 - 1) < 1e-2) continue;
      reached += a.inside;
      for (std::size_t i = 0; i < kValues; ++i) {
        const auto shifted = [&](double h) {
          std::vector<Splat> moved = splats;
          moved[k][i] += h;
          return loss(moved);
        };
        const double h = 1e-4;
        const double numeric =
            (8 * (shifted(h) - shifted(-h)) - (shifted(2 * h) - shifted(-2 * h))) / (12 * h);
        error = std::max(error, std::abs(numeric - analytic[k][i]));
        norm = std::max(norm, std::abs(analytic[k][i]));
      }
    }
    if (norm > 0) worst = std::max(worst, error / norm);
  }
  CHECK(reached > 300);
  WARN("largest relative error " << worst);
  CHECK(worst < 3.8e-11);  // the largest error observed is 1.9e-11 (Gaussian kernel)
}

#if UBS_FALLOFF == UBS_FALLOFF_GAUSSIAN
TEST_CASE("the Gaussian kernel ends at an alpha of 1/255", "[math][variants]") {
  const Splat s{0, 0, 1, 0, 1, 0.8, 0, 1, 1, 1};
  const auto alpha = [&](double distance, double opacity) {
    Splat moved = s;
    moved[5] = opacity;
    return blend_alpha(blend_splat(moved), distance, 0).alpha;
  };
  CHECK(alpha(1, 0.8) == Approx(0.8 * std::exp(-0.5)));
  CHECK(alpha(2.99, 0.8) == Approx(0.8 * std::exp(-0.5 * 2.99 * 2.99)));
  // A Gaussian with opacity 1 falls to 1/255 at 3.329 standard deviations. Alpha is at most 0.99.
  CHECK(alpha(3.32, 1) == Approx(std::exp(-0.5 * 3.32 * 3.32)));
  CHECK(alpha(3.33, 1) == 0);
  CHECK(alpha(3.25, 0.8) == Approx(0.8 * std::exp(-0.5 * 3.25 * 3.25)));
  CHECK(alpha(3.27, 0.8) == 0);
  CHECK(alpha(0, 1.001 / 255) > 0);
  CHECK(alpha(0, 0.999 / 255) == 0);
  CHECK(alpha(0, 0.995) == Approx(0.99));
}
#endif
