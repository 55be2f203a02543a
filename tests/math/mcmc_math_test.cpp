// SPDX-License-Identifier: Apache-2.0
// Tests kernels/math/mcmc.h in double precision: the opacities of a source and its copies, the sampling
// weights, and the noise. Also tests the numbers of splats that result from growth.
// clang-format off
#include <catch2/catch.hpp>

#include <cmath>
#include <limits>

// Each of these headers needs the headers before it.
#include "kernels/dialect/dialect.h"
#include "kernels/limits.h"
#include "kernels/layout.h"
#include "kernels/math/elementary.h"
#include "kernels/math/rotation.h"
#include "kernels/math/covariance.h"
#include "kernels/math/mcmc.h"
// clang-format on

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

double sigmoid(double x) { return 1 / (1 + std::exp(-x)); }

}  // namespace

TEST_CASE("a source and its copies absorb as much light as the source before the split", "[mcmc]") {
  for (const double raw : {-4.0, -1.0, 0.0, 2.0, 8.0})
    for (const double parts : {2.0, 3.0, 7.0, 20.0}) {
      const double opacity = sigmoid(split_raw_opacity(raw, parts));
      if (opacity < 0.0050001) continue;  // the opacity has been raised to its minimum of 0.005
      CHECK(std::pow(1 - opacity, parts) == Approx(1 - sigmoid(raw)).epsilon(1e-9));
    }
}

TEST_CASE("split opacities stay between 0.005 and 1 - 2^-23", "[mcmc]") {
  const double low = 0.005, high = 1 - std::ldexp(1.0, -23);
  CHECK(sigmoid(UBS_RAW_OPACITY_MIN) == Approx(low).epsilon(1e-14));
  CHECK(1 - sigmoid(UBS_RAW_OPACITY_MAX) == Approx(1 - high).epsilon(1e-9));
  CHECK(split_raw_opacity(-5.0, 2.0) == UBS_RAW_OPACITY_MIN);
  CHECK(split_raw_opacity(0.0, 1e6) == UBS_RAW_OPACITY_MIN);
  CHECK(split_raw_opacity(1000.0, 2.0) == UBS_RAW_OPACITY_MAX);
  CHECK(split_raw_opacity(kInfinity, 2.0) == UBS_RAW_OPACITY_MAX);
  CHECK(split_raw_opacity(-kInfinity, 2.0) == UBS_RAW_OPACITY_MIN);
  CHECK(split_raw_opacity(kNan, 2.0) == UBS_RAW_OPACITY_MIN);
}

TEST_CASE("the opacity of a source without copies does not change", "[mcmc]") {
  for (const double raw : {-5.0, -2.0, 0.0, 3.0, 15.0})
    CHECK(split_raw_opacity(raw, 1.0) == Approx(raw).epsilon(1e-12).margin(1e-12));
}

TEST_CASE("over the draws, the covariance of a copy about its source is that of the source before",
          "[mcmc]") {
  for (const double spread : {0.0, 0.1, 0.35, 1.0, 5.0}) {
    const double shrink = copy_shrink(spread);
    for (const double raw : {-40.0, -3.0, 0.0, 2.0, 50.0}) {
      const double before = std::log1p(std::exp(raw));
      const double after = std::log1p(std::exp(copy_raw_scale(raw, shrink)));
      CHECK(after * after * (1 + spread * spread) == Approx(before * before).epsilon(1e-12));
    }
  }
  for (const double raw : {kNan, kInfinity, -kInfinity, -800.0}) {  // the softplus of -800 is 0
    const double after = copy_raw_scale(raw, 0.5);
    CHECK((std::isnan(raw) ? std::isnan(after) : after == raw));
  }
}

TEST_CASE("a copy is displaced by M times normally distributed numbers", "[mcmc]") {
  const double a0 = 0.3, a1 = -0.7, a2 = 1.1, s[3] = {0.4, -1.0, 0.1}, normals[3] = {0.5, -1.2, 0.8};
  const SpatialFrame frame = spatial_frame({{a0, a1, a2}, {s[0], s[1], s[2]}});
  const double rotation[3][3] = {{1, a0, a1}, {-a0, 1, a2}, {-a1, -a2, 1}};
  const Vec3 got = copy_displacement(frame, {{normals[0], normals[1], normals[2]}}, 0.35);
  for (int r = 0; r < 3; ++r) {
    double expected = 0;
    for (int c = 0; c < 3; ++c) expected += 0.35 * rotation[r][c] * std::log(1 + std::exp(s[c])) * normals[c];
    CHECK(got.e[r] == Approx(expected).epsilon(1e-12));
  }
  const Vec3 none = copy_displacement(spatial_frame({{0, 0, 0}, {kInfinity, 1, 1}}), {{1, 1, 1}}, 1);
  CHECK((none.e[0] == 0 && none.e[1] == 0 && none.e[2] == 0));
}

TEST_CASE("sampling weights are rounded multiples of opacities; sampling_weight_alive() is 0 for dead splats",
          "[mcmc]") {
  CHECK(sampling_weight(0.0) == 8388608.0);
  CHECK(sampling_weight(100.0) == 16777216.0);
  CHECK(sampling_weight(-100.0) == 0.0);
  CHECK(sampling_weight(kNan) == 0.0);
  CHECK(sampling_weight_alive(kNan) == 0.0);
  const double edge = std::log(0.005 / 0.995);
  CHECK(sampling_weight_alive(edge - 1e-9) == 0.0);
  CHECK(sampling_weight_alive(edge + 1e-9) == 83886.0);
  CHECK(sampling_weight(edge - 1e-9) == 83886.0);
}

TEST_CASE("noise is scaled by (1 - o)^100, where o is the opacity", "[mcmc]") {
  for (const double raw : {-10.0, -5.2933, -2.0, 0.0, 1.0})
    CHECK(noise_gate(raw) == Approx(std::pow(1 - sigmoid(raw), 100)).epsilon(1e-10));
  CHECK(noise_gate(-5.2933) == Approx(0.606).epsilon(2e-3));  // the value of method.md 4.3
}

TEST_CASE("the displacement by noise is Sigma_x times normally distributed numbers, times the gate",
          "[mcmc]") {
  const double a0 = 0.3, a1 = -0.7, a2 = 1.1, s[3] = {0.4, -1.0, 0.1};
  const SpatialFrame frame = spatial_frame({{a0, a1, a2}, {s[0], s[1], s[2]}});
  const double rotation[3][3] = {{1, a0, a1}, {-a0, 1, a2}, {-a1, -a2, 1}};
  const double normals[3] = {0.5, -1.2, 0.8};
  const Vec3 got = noise_displacement(frame, -4.0, {{normals[0], normals[1], normals[2]}}, 0.02);
  for (int r = 0; r < 3; ++r) {
    double expected = 0;
    for (int c = 0; c < 3; ++c)
      for (int k = 0; k < 3; ++k) {
        const double scale = std::log(1 + std::exp(s[k]));
        expected += rotation[r][k] * scale * scale * rotation[c][k] * normals[c];
      }
    CHECK(got.e[r] == Approx(expected * std::pow(1 - sigmoid(-4.0), 100) * 0.02).epsilon(1e-10));
  }
}

TEST_CASE("noise that is not finite does not move a splat", "[mcmc]") {
  const SpatialFrame huge = spatial_frame({{0, 0, 0}, {1e200, 1, 1}});
  const Vec3 none = noise_displacement(huge, -9.0, {{1, 1, 1}}, 1);
  CHECK((none.e[0] == 0 && none.e[1] == 0 && none.e[2] == 0));
  const Vec3 nan = noise_displacement(spatial_frame({{0, 0, 0}, {1, 1, 1}}), kNan, {{1, 1, 1}}, 1);
  CHECK((nan.e[0] == 0 && nan.e[1] == 0 && nan.e[2] == 0));
}

// Evaluates the growth rule of method.md 4.3, floor(1.02 P), for two scenes of the paper, starting from the
// numbers of their initial points.
TEST_CASE("growth by 2 % gives the expected number of splats, and reaches the maximum when expected",
          "[mcmc]") {
  const auto grown = [](long count) {
    return static_cast<long>(std::floor(1.02 * static_cast<double>(count)));
  };
  long stump = 32049;
  for (int event = 0; event < 244; ++event) stump = grown(stump);
  CHECK(stump == 4016842);
  long bicycle = 54275;
  int iteration = 500;
  while (bicycle < 6000000) bicycle = grown(bicycle), iteration += 100;
  CHECK(iteration == 24300);
}
