// SPDX-License-Identifier: Apache-2.0
// Compares the functions of kernels/math/adam.h, compiled in double precision, with explicit sums over all
// gradients, and the gradients of the penalties with finite differences.
// clang-format off
#include <catch2/catch.hpp>

#include <cmath>
#include <limits>
#include <random>
#include <vector>

// Each of these headers needs the headers before it.
#include "kernels/dialect/dialect.h"
#include "kernels/layout.h"
#include "kernels/loss_weights.h"
#include "kernels/math/elementary.h"
#include "kernels/math/adam.h"
// clang-format on

namespace {

AdamConstants constants(int step) {
  AdamConstants k;
  k.beta1 = 0.9, k.beta2 = 0.999, k.epsilon = 1e-15;
  k.inverse_bias1 = 1 / (1 - std::pow(0.9, step));
  k.inverse_sqrt_bias2 = 1 / std::sqrt(1 - std::pow(0.999, step));
  return k;
}

template <class F>
double central_difference(const F& f, double x) {
  constexpr double kStep = 1e-6;
  return (f(x + kStep) - f(x - kStep)) / (2 * kStep);
}

}  // namespace

TEST_CASE("adam steps agree with explicit sums over all gradients", "[adam]") {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  AdamState state{0.3, 0, 0};
  // The expected moments are computed with the sum m_t = (1-b) sum b^(t-i) g_i of Kingma and Ba, not with the
  // recurrence.
  std::vector<double> gradients;
  double param = 0.3;
  for (int step = 1; step <= 60; ++step) {
    gradients.push_back(normal(random));
    state = adam_update(state, gradients.back(), 0.01, constants(step));
    double mean = 0, square = 0, mean_weight = 0, square_weight = 0;
    for (int i = 0; i < step; ++i) {
      const double w1 = std::pow(0.9, step - 1 - i), w2 = std::pow(0.999, step - 1 - i);
      mean += w1 * gradients[i], mean_weight += w1;
      square += w2 * gradients[i] * gradients[i], square_weight += w2;
    }
    param -= 0.01 * (mean / mean_weight) / (std::sqrt(square / square_weight) + 1e-15);
    REQUIRE(state.param == Approx(param).epsilon(1e-12));
  }
}

TEST_CASE("the first adam step has the size of the learning rate", "[adam]") {
  for (const double gradient : {1e-9, -3e-3, 1.0, -1e8}) {
    const AdamState s = adam_update({0, 0, 0}, gradient, 0.05, constants(1));
    CHECK(s.param == Approx(gradient > 0 ? -0.05 : 0.05).epsilon(2e-6));
  }
}

TEST_CASE("a zero gradient gives no adam step, and epsilon damps the step for a tiny gradient", "[adam]") {
  const AdamState still = adam_update({0.7, 0, 0}, 0, 0.05, constants(1));
  CHECK(still.param == 0.7);
  const AdamState tiny = adam_update({0, 0, 0}, 1e-20, 0.05, constants(1));
  CHECK(tiny.param == Approx(-0.05 * 1e-20 / (1e-20 + 1e-15)).epsilon(1e-12));
}

TEST_CASE("an Adam state is not finite if any of its three numbers is not finite", "[adam]") {
  constexpr double kMost = std::numeric_limits<double>::max();
  CHECK_FALSE(adam_not_finite({0, 0, 0}));
  CHECK_FALSE(adam_not_finite({kMost, kMost, kMost}));  // although the sum of the numbers is not finite
  CHECK_FALSE(adam_not_finite({-kMost, 1e-310, 0}));
  for (const double bad : {std::nan(""), HUGE_VAL, -HUGE_VAL}) {
    CHECK(adam_not_finite({bad, 1, 1}));
    CHECK(adam_not_finite({1, bad, 1}));
    CHECK(adam_not_finite({1, 1, bad}));
  }
}

TEST_CASE("the gradients of the penalties agree with finite differences", "[adam]") {
  for (const double raw : {-30.0, -4.0, -0.3, 0.0, 0.9, 7.0}) {
    const auto sigmoid = [](double x) { return 0.25 / (1 + std::exp(-x)); };
    const auto softplus = [](double x) { return 0.25 * std::log(1 + std::exp(x)); };
    CHECK(opacity_penalty_vjp(raw, 0.25) ==
          Approx(central_difference(sigmoid, raw)).epsilon(1e-7).margin(1e-10));
    CHECK(scale_penalty_vjp(raw, 0.25) ==
          Approx(central_difference(softplus, raw)).epsilon(1e-7).margin(1e-10));
  }
  const PenaltyWeights both{0.5f, 0.25f}, no_scale{0.5f, 0};
  for (int row = 0; row < kRowCount; ++row) {
    const bool is_scale = row >= kRowScale && row < kRowScale + 3;
    CHECK((has_penalty(row, both) != 0) == (row == kRowOpacity || is_scale));
    CHECK((has_penalty(row, no_scale) != 0) == (row == kRowOpacity));
  }
  CHECK(penalty_vjp(kRowOpacity, 0.9, both) == opacity_penalty_vjp(0.9, 0.5));
  CHECK(penalty_vjp(kRowScale + 2, 0.9, both) == scale_penalty_vjp(0.9, 0.25));
  // There must be no cancellation in o (1 - o), even if 1 - o is far below an ulp of o.
  CHECK(opacity_penalty_vjp(50.0, 1.0) == Approx(std::exp(-50.0)).epsilon(1e-12));
}
