// SPDX-License-Identifier: Apache-2.0
// This file compares many small random cases with float64. The options --seed, --first and --cases determine
// the cases. They are processed in batches: the oracle computes the expected results of a batch on all cores,
// and then the device renders the batch. The two do not run at the same time, because a CPU device would use
// the same cores.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "host/base/error.hpp"
#include "host/base/parallel.hpp"
#include "tests/stress/random_case.hpp"
#include "tests/stress/row.hpp"

namespace ubs::stress {
namespace {

constexpr std::int64_t kBatch = 64;

void check_random_cases(Row& row, DeviceRunner& runner) {
  const StressOptions& o = row.options();
  for (std::int64_t done = 0; done < o.cases; done += kBatch) {
    const std::size_t count = static_cast<std::size_t>(std::min(kBatch, o.cases - done));
    const std::uint64_t first = static_cast<std::uint64_t>(o.first) + static_cast<std::uint64_t>(done);
    std::vector<Case> cases(count);
    std::vector<Expectation> expected(count);
    parallel_for(count, [&](std::size_t i) {
      cases[i] = random_case(static_cast<std::uint64_t>(o.seed), first + i);
      expected[i] = expect(cases[i]);
    });
    for (std::size_t i = 0; i < count; ++i) {
      INFO(fmt::format("repeat: ubs-lab stress 'random cases' --seed {} --first {} --cases 1", o.seed,
                       first + i));
      row.take(cases[i], answer(cases[i], expected[i], runner));
    }
  }
}

}  // namespace

TEST_CASE_METHOD(Row, "random cases", "[random]") {
  check_random_cases(*this, runner());
  const auto cases = static_cast<std::size_t>(options().cases);
  if (cases >= 100) CHECK(count(Outcome::float64) > cases * 4 / 5);
}

// This test case is hidden, because it always fails. stress_cli_test.cpp uses it to test the output of a
// failure.
TEST_CASE_METHOD(Row, "random cases on a faulty device", "[.]") {
  DeviceRunner faulty(device(), runner().raster());
  faulty.disturb = [](const Case&, DeviceResult& result) { std::ranges::fill(result.image, NAN); };
  check_random_cases(*this, faulty);
}

TEST_CASE_METHOD(Row, "a random case depends only on its seed and number", "[random]") {
  const Case a = random_case(4, 77), b = random_case(4, 77), other = random_case(4, 78);
  CHECK(same_bits(a.model.values, b.model.values));
  CHECK(a.camera.translation == b.camera.translation);
  CHECK_FALSE(same_bits(a.model.values, other.model.values));
}

// The device uses cameras in single precision. If the values of a camera could not be represented as float,
// the oracle would render another camera. For example, a splat exactly at the centre of the camera would be
// beside the centre for the device. In the test, `volatile` makes the compiler round.
TEST_CASE_METHOD(Row, "random cases have cameras whose values can be represented as float", "[random]") {
  const auto rounded = [](double x) {
    const volatile float f = static_cast<float>(x);
    return static_cast<double>(f);
  };
  for (std::uint64_t i = 0; i < 400; ++i) {
    const Case c = random_case(1, i);
    INFO(c.name);
    for (const double x : {c.camera.fx, c.camera.fy, c.camera.cx, c.camera.cy, c.camera.time})
      CHECK(x == rounded(x));
    for (const double x : c.camera.extra) CHECK(x == rounded(x));
    const std::array<double, 3> centre = c.camera.centre();
    // The product of rotation and translation has errors of a few double ulps of the farthest coordinate.
    const double far = std::max({std::abs(centre[0]), std::abs(centre[1]), std::abs(centre[2])});
    for (const double x : centre) CHECK(std::abs(x - rounded(x)) <= 1e-14 * far);
  }
}

TEST_CASE_METHOD(Row, "random cases are the same with every compiler", "[random]") {
  double sum = 0;
  for (std::uint64_t i = 0; i < 200; ++i)
    for (const float v : random_case(1, i).model.values) sum += std::isnan(v) ? 0 : std::tanh(v);
  CHECK(sum == Approx(1041.43299744).epsilon(1e-7));  // the value with GCC 12 and clang 14
}

TEST_CASE_METHOD(Row, "random cases contain invalid values, wide images and distant cameras", "[random]") {
  std::size_t drawn = 0, splats = 0, poisoned = 0, wide = 0, far = 0;
  for (std::uint64_t i = 0; i < 400; ++i) {
    const Case c = random_case(1, i);
    const Expectation e = expect(c);
    drawn += e.study.drawn, splats += c.model.count;
    wide += c.camera.width > 4000;
    far += std::abs(c.camera.centre()[0]) > 1e5;
    for (const float v : c.model.values) poisoned += !std::isfinite(v);
  }
  CHECK(drawn > splats / 2);
  CHECK(drawn < splats);
  CHECK(poisoned > 20);
  CHECK(wide > 3);
  CHECK(far > 10);
}

TEST_CASE_METHOD(Row, "repeat: random cases rendered twice are bit-identical", "[random]") {
  for (std::uint64_t number = 0; number < 60; ++number) {
    const Case c = random_case(3, number);
    INFO(c.name);
    const std::vector<float> weights = pixel_weights(c);
    const DeviceResult a = runner().run(c, weights), b = runner().run(c, weights);
    CHECK(same_bits(a.image, b.image));
    CHECK(same_bits(a.gradient.values, b.gradient.values));
  }
}

}  // namespace ubs::stress
