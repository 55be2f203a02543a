// SPDX-License-Identifier: Apache-2.0
// Compares results of the stages AdamStep and Regularise on every device with results in double precision.
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "host/base/error.hpp"
#include "host/lab/oracle/learning.hpp"
#include "tests/support/stages_fixture.hpp"

namespace {

using namespace ubs;
using test::uploaded;

std::size_t row_count(int dim) { return static_cast<std::size_t>(dim) * (dim + 1) / 2 + 2 * dim + 2; }
// Indices of parameter rows, as in kernels/layout.h.
constexpr std::size_t kRowOfOpacity = 6;
std::size_t scale_row(int dim) { return 8 + 2 * static_cast<std::size_t>(dim - 3); }

template <class F>
void for_each_stages(int dim, const F& f) {
  test::for_each_stages(f, {.dim = dim});
}

std::vector<float> random_values(std::size_t size, unsigned seed, float spread = 1) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal(0, spread);
  std::vector<float> values(size);
  for (float& value : values) value = normal(random);
  return values;
}

}  // namespace

TEST_CASE("adam: five steps agree with double precision in every parameter row", "[adam][device]") {
  for (const int dim : {3, 6, 7})
    for_each_stages(dim, [dim](Device& device, Stages& stages) {
      const std::uint32_t count = 100, stride = 128;
      const std::size_t rows = row_count(dim);
      std::vector<float> rates(rows);
      for (std::size_t k = 0; k < rows; ++k) rates[k] = 1e-3f * static_cast<float>(k + 1);
      const std::vector<float> start = random_values(rows * stride, 1);
      Buffer<float> params = uploaded(device, start), lr = uploaded(device, rates);
      Buffer<float> m1(device, "m1", start.size()), m2(device, "m2", start.size());
      m1.zero();
      m2.zero();
      std::vector<oracle::AdamValue> expected;
      for (const float value : start) expected.push_back({.parameter = value});
      for (std::uint64_t step = 1; step <= 5; ++step) {
        const std::vector<float> g = random_values(start.size(), static_cast<unsigned>(step), 0.1f);
        Buffer<float> gradient = uploaded(device, g);
        AdamStep adam;
        adam.splats = {params.view(), count, stride};
        adam.v_params = gradient.view();
        adam.moment1 = m1.view();
        adam.moment2 = m2.view();
        adam.learning_rates = lr.view();
        adam.step = step;
        stages.adam(adam);
        device.finish();
        for (std::size_t i = 0; i < expected.size(); ++i)
          expected[i] = oracle::adam(expected[i], g[i], rates[i / stride], step);
      }
      const std::vector<float> got = params.download(), got1 = m1.download(), got2 = m2.download();
      for (std::size_t k = 0; k < rows; ++k)
        for (std::uint32_t i = 0; i < count; ++i) {
          const std::size_t at = k * stride + i;
          // The largest errors observed on PoCL are 2.2e-7 (|p| + 0.1) for the parameter p, 1.7e-7 (|m| +
          // 0.01) for the first moment m, and 1.8e-7 v for the second moment v.
          const auto& [p, m, v] = expected[at];
          REQUIRE(std::abs(got[at] - p) < 4.4e-7 * (std::abs(p) + 0.1));
          REQUIRE(std::abs(got1[at] - m) < 3.4e-7 * (std::abs(m) + 0.01));
          REQUIRE(std::abs(got2[at] - v) < 3.6e-7 * v);
        }
    });
}

TEST_CASE("adam: the bias correction is accurate for small and large step numbers", "[adam][device]") {
  for_each_stages(6, [](Device& device, Stages& stages) {
    for (const std::uint64_t step : {std::uint64_t{1}, std::uint64_t{1000}, std::uint64_t{1} << 40}) {
      const std::size_t size = row_count(6) * 64;
      Buffer<float> params = uploaded(device, std::vector<float>(size, 0.0f));
      Buffer<float> gradient = uploaded(device, std::vector<float>(size, 0.5f));
      Buffer<float> m1 = uploaded(device, std::vector<float>(size, 0.25f));
      Buffer<float> m2 = uploaded(device, std::vector<float>(size, 0.125f));
      Buffer<float> lr = uploaded(device, std::vector<float>(row_count(6), 0.01f));
      stages.adam({{params.view(), 64, 64},
                   gradient.view(),
                   m1.view(),
                   m2.view(),
                   lr.view(),
                   0.9f,
                   0.999f,
                   1e-15f,
                   step});
      const double beta1 = 0.9f, beta2 = 0.999f, s = static_cast<double>(step);
      const double m = beta1 * 0.25 + (1 - beta1) * 0.5, v = beta2 * 0.125 + (1 - beta2) * 0.25;
      const double expected = -0.01 * m / (1 - std::pow(beta1, s)) / std::sqrt(v / (1 - std::pow(beta2, s)));
      CHECK(params.download()[77] == Approx(expected).epsilon(1e-6));
    }
  });
}

// A gradient of 1e-20 gives a second moment of 1e-43 on devices that support denormal numbers, and 0 on other
// devices. The steps nevertheless only differ by 1e-5, because epsilon = 1e-15 is much larger than the square
// root of the moment.
TEST_CASE("adam: steps for zero, tiny and denormal gradients agree with double precision", "[adam][device]") {
  for_each_stages(6, [](Device& device, Stages& stages) {
    const float values[] = {0.0f, 1e-20f, -1e-20f, 1e-30f, 1e-40f, -1e-45f, 1e-12f, 1e18f};
    const std::size_t size = row_count(6) * 64;
    std::vector<float> g(size);
    for (std::size_t i = 0; i < size; ++i) g[i] = values[i % 8];
    Buffer<float> params = uploaded(device, std::vector<float>(size, 0.0f)), gradient = uploaded(device, g);
    Buffer<float> m1 = uploaded(device, std::vector<float>(size, 0.0f));
    Buffer<float> m2 = uploaded(device, std::vector<float>(size, 0.0f));
    Buffer<float> lr = uploaded(device, std::vector<float>(row_count(6), 1.0f));
    stages.adam({{params.view(), 64, 64}, gradient.view(), m1.view(), m2.view(), lr.view()});
    const std::vector<float> got = params.download();
    for (std::size_t i = 0; i < size; ++i) {
      const double magnitude = std::abs(static_cast<double>(g[i])), rest = magnitude > 3e-18 ? magnitude : 0;
      const double kept = g[i] == 0 ? 0 : -g[i] / (magnitude + 1e-15), flushed = -g[i] / (rest + 1e-15);
      // The largest error observed on PoCL, which supports denormals, is 2.6e-6, for the gradient 1e-40.
      // Without denormals, the lost moments change the parameter by less than 1e-22.
      const double error = std::min(std::abs(got[i] - kept), std::abs(got[i] - flushed));
      REQUIRE(error < 5.2e-6 * std::abs(kept) + 1e-22);
    }
  });
}

TEST_CASE("adam with a sentinel gives the same bits, and stops after a gradient that is not finite",
          "[adam][device]") {
  for_each_stages(6, [](Device& device, Stages& stages) {
    const std::uint32_t count = 100, stride = 128;
    const std::size_t size = row_count(6) * stride;
    std::vector<float> g = random_values(size, 3, 0.1f);
    const std::vector<float> start = random_values(size, 4);
    for (std::size_t k = 0; k < row_count(6); ++k)
      g[k * stride + count] = std::numeric_limits<float>::quiet_NaN();
    Buffer<float> lr = uploaded(device, std::vector<float>(row_count(6), 0.01f));
    struct State {
      Buffer<float> params, m1, m2;
    };
    const auto fresh = [&] {
      return State{uploaded(device, start), uploaded(device, std::vector<float>(size, 0.1f)),
                   uploaded(device, std::vector<float>(size, 0.2f))};
    };
    Buffer<std::uint32_t> sentinel(device, "sentinel", 1);
    sentinel.zero();
    const auto step = [&](State& s, const std::vector<float>& gradient, std::uint32_t stamp) {
      Buffer<float> v_params = uploaded(device, gradient);
      AdamStep adam{{s.params.view(), count, stride}, v_params.view(), s.m1.view(), s.m2.view(), lr.view()};
      if (stamp > 0) adam.sentinel = sentinel.view();
      adam.stamp = stamp;
      stages.adam(adam);
      device.finish();
    };
    State plain = fresh(), watched = fresh();
    step(plain, g, 0);
    step(watched, g, 5);  // the padding is not checked
    CHECK(sentinel.download()[0] == 0);
    const auto same = [&](const Buffer<float>& a, const Buffer<float>& b, std::size_t except) {
      const std::vector<float> x = a.download(), y = b.download();
      for (std::size_t i = 0; i < size; ++i)
        if (i % stride < count && i != except) REQUIRE(x[i] == y[i]);
    };
    same(plain.params, watched.params, size);
    same(plain.m1, watched.m1, size);
    same(plain.m2, watched.m2, size);

    const std::size_t bad = 20 * stride + 37;
    const float before = watched.params.download()[bad];
    for (const float value :
         {std::numeric_limits<float>::quiet_NaN(), -std::numeric_limits<float>::infinity(), 1e21f}) {
      State a = fresh(), b = fresh();
      std::vector<float> poisoned = g;
      poisoned[bad] = value;
      sentinel.zero();
      step(a, g, 0);
      step(b, poisoned, 7);
      CHECK(sentinel.download()[0] == 7);
      CHECK(b.params.download()[bad] == start[bad]);
      CHECK_FALSE(std::isfinite(b.m2.download()[bad]));
      same(a.params, b.params, bad);
      step(b, g, 8);  // changes nothing, because the sentinel contains the stamp 7
      CHECK(sentinel.download()[0] == 7);
      same(a.params, b.params, bad);
    }
    CHECK(before != start[bad]);
    CHECK_THROWS_AS(stages.adam({{watched.params.view(), count, stride},
                                 lr.view(),
                                 watched.m1.view(),
                                 watched.m2.view(),
                                 lr.view(),
                                 0.9f,
                                 0.999f,
                                 1e-15f,
                                 1,
                                 sentinel.view(),
                                 0}),
                    Error);
  });
}

TEST_CASE("penalties change only the gradients of opacities and spatial scales", "[adam][device]") {
  for (const int dim : {3, 6, 7})
    for_each_stages(dim, [dim](Device& device, Stages& stages) {
      const std::uint32_t count = 100, stride = 128;
      const std::size_t rows = row_count(dim);
      const std::vector<float> raw = random_values(rows * stride, 5, 4),
                               before = random_values(rows * stride, 6);
      Buffer<float> params = uploaded(device, raw);
      for (const float scale_weight : {0.0f, 0.3f}) {
        Buffer<float> gradient = uploaded(device, before);
        stages.regularise({{params.view(), count, stride}, gradient.view(), {0.5f, scale_weight}});
        const std::vector<float> after = gradient.download();
        for (std::size_t k = 0; k < rows; ++k)
          for (std::uint32_t i = 0; i < count; ++i) {
            const std::size_t at = k * stride + i;
            double expected = before[at];
            if (k == kRowOfOpacity) expected += oracle::opacity_penalty(raw[at], 0.5, count);
            if (k >= scale_row(dim) && k < scale_row(dim) + 3)
              expected += oracle::scale_penalty(raw[at], scale_weight, count);
            // The largest error observed on PoCL is 5.7e-8 (|v| + 0.01), where v is the expected gradient.
            REQUIRE(std::abs(after[at] - expected) < 1.1e-7 * (std::abs(expected) + 0.01));
          }
      }
    });
}

TEST_CASE("optimiser stages accept 0 splats and reject invalid calls", "[adam][device]") {
  for_each_stages(6, [](Device& device, Stages& stages) {
    const std::size_t size = row_count(6) * 64;
    Buffer<float> a = uploaded(device, std::vector<float>(size, 1.0f)),
                  lr = uploaded(device, std::vector<float>(row_count(6), 1.0f));
    stages.adam({{a.view(), 0, 64}, a.view(), a.view(), a.view(), lr.view()});
    stages.regularise({{a.view(), 0, 64}, a.view(), {1.0f, 1.0f}});
    CHECK(a.download() == std::vector<float>(size, 1.0f));
    AdamStep zeroth{{a.view(), 64, 64}, a.view(), a.view(), a.view(), lr.view()};
    zeroth.step = 0;
    CHECK_THROWS_AS(stages.adam(zeroth), Error);
    CHECK_THROWS_AS(stages.adam({{a.view(), 65, 64}, a.view(), a.view(), a.view(), lr.view()}), Error);
  });
}
