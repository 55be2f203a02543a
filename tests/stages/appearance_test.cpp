// SPDX-License-Identifier: Apache-2.0
// Tests the corrections of exposure and white balance (the setting `appearance`): on every device, results of
// the stages ImageLoss and AppearanceStep are compared with results in double precision.
#include "tests/reference/appearance.hpp"

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <random>

#include "host/lab/oracle/oracle_stages.hpp"
#include "tests/support/stages_fixture.hpp"

namespace {

using namespace ubs;
using test::for_each_stages;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

using Numbers = std::array<double, 12>;
constexpr Numbers kBalance{0.4, 0.1, -0.05, 0.03, 0.02, -0.5, 0.07, -0.04, -0.08, 0.06, 0.2, 0.01};

struct Pictures {
  int width, height;
  std::vector<float> image, target;  // (3, height, width)
  std::vector<std::uint8_t> mask;    // empty: all pixels are used
};

Pictures pictures(int width, int height, bool masked) {
  std::mt19937 random(static_cast<unsigned>(97 * width + height));
  std::uniform_real_distribution<float> noise(-0.1f, 0.1f);
  Pictures p{width, height, {}, {}, {}};
  for (int i = 0; i < 3 * width * height; ++i) {
    const float value = 0.5f + 0.35f * std::sin(0.11f * static_cast<float>(i));
    p.target.push_back(value);
    p.image.push_back(value + noise(random));
  }
  for (int i = 0; masked && i < width * height; ++i) p.mask.push_back(i % 7 == 0 || i % 50 < 9 ? 0 : 255);
  return p;
}

struct Result {
  std::vector<float> sums, v_image, v_numbers;  // v_image (3, height, width)
};

// Runs the stage ImageLoss. `numbers` contains the 12 numbers of the correction; if it is empty, the image is
// not corrected.
Result run(Device& device, Stages& stages, const Pictures& p, const std::vector<float>& numbers) {
  const ImageShape shape{p.width, p.height};
  const auto pixels = static_cast<std::size_t>(p.width * p.height);
  const auto place = [&](std::size_t i) {
    return i / pixels * shape.plane() +
           i % pixels / static_cast<std::size_t>(p.width) * static_cast<std::size_t>(shape.pitch()) +
           i % static_cast<std::size_t>(p.width);
  };
  std::vector<float> padded(3 * shape.plane(), kNan);  // the stage must not use values outside the image
  for (std::size_t i = 0; i < 3 * pixels; ++i) padded[place(i)] = p.image[i];
  Buffer<float> image(device, "image", padded.size()), v_image(device, "gradient", padded.size()),
      target(device, "target", p.target.size()), sums(device, "sums", 8), values(device, "numbers", 15),
      v_values(device, "gradient of numbers", 14);
  Buffer<std::uint8_t> mask(device, "mask", std::max<std::size_t>(1, p.mask.size()));
  image.upload(padded), target.upload(p.target);
  v_values.upload(std::vector<float>(14, -7.0f));
  ImageLoss loss{.shape = shape, .image = image.view()};
  loss.target_float = target.view(), loss.v_image = v_image.view(), loss.sums = sums.view();
  if (!p.mask.empty()) {
    mask.upload(p.mask);
    loss.mask = mask.view();
    loss.counted = static_cast<std::uint32_t>(std::ranges::count(p.mask, std::uint8_t{255}));
  }
  if (!numbers.empty()) {
    values.upload(numbers, 3);
    loss.appearance = values.view(), loss.appearance_offset = 3;
    loss.v_appearance = v_values.view(), loss.v_appearance_offset = 1;
  }
  stages.image_loss(loss);
  Result r{sums.download(), std::vector<float>(3 * pixels), {}};
  const std::vector<float> all = v_image.download(), around = v_values.download();
  for (std::size_t i = 0; i < 3 * pixels; ++i) r.v_image[i] = all[place(i)];
  CHECK(around.front() == -7.0f);
  CHECK(around.back() == -7.0f);
  r.v_numbers.assign(around.begin() + 1, around.end() - 1);
  return r;
}

// Returns the largest difference divided by the largest value.
template <typename A, typename B>
double error(const A& got, const B& want) {
  double worst = 0, largest = 0;
  REQUIRE(got.size() == want.size());
  for (std::size_t i = 0; i < got.size(); ++i) {
    worst = std::max(worst, std::abs(static_cast<double>(got[i]) - static_cast<double>(want[i])));
    largest = std::max(largest, std::abs(static_cast<double>(want[i])));
    REQUIRE(std::isfinite(got[i]));
  }
  return worst / largest;
}

// The bounds are twice the largest errors observed on PoCL, with CPU and with GPU kernels: 5.8e-6 for the
// gradient of the image, 1.5e-7 for the gradient of the numbers, and 6.3e-8 for the numbers after the steps.
constexpr double kImageError = 1.2e-5, kNumbersError = 3e-7, kStepError = 1.3e-7;

const std::vector<float> kFloats(kBalance.begin(), kBalance.end());

TEST_CASE("appearance: gradients of the image and of the numbers match the oracle", "[appearance][device]") {
  for_each_stages([](Device& device, Stages& stages) {
    for (const auto& [width, height] : {std::pair{5, 3}, {16, 16}, {33, 50}, {117, 70}}) {
      INFO(width << " x " << height);
      const Pictures p = pictures(width, height, false);
      const Numbers rows = [] {
        Numbers n{};
        std::ranges::copy(kFloats, n.begin());
        return n;
      }();
      const std::vector<double> image(p.image.begin(), p.image.end()),
          target(p.target.begin(), p.target.end());
      const std::vector<double> seen = oracle::balanced_image(rows, image);
      const oracle::BalanceGradient want = oracle::balance_gradient(
          rows, image, oracle::image_gradient(seen, target, width, height, loss_weights(0.2f)));
      const Result got = run(device, stages, p, kFloats);
      double l1 = 0;
      for (std::size_t i = 0; i < seen.size(); ++i)
        l1 += std::abs(seen[i] - target[i]) / static_cast<double>(seen.size());
      CHECK(got.sums[0] == Approx(l1).epsilon(1e-6));
      CHECK(got.sums[1] == Approx(oracle::ssim(seen, target, 3, height, width)).margin(1e-6));
      CHECK(error(got.v_image, want.image) < kImageError);
      CHECK(error(got.v_numbers, want.rows) < kNumbersError);
    }
  });
}

// With a mask, the gradient of the numbers is the one that follows from the gradient of a masked loss. If all
// numbers are 0, the results are bit-identical to those without a correction.
TEST_CASE("appearance: masked pixels do not count, and numbers of 0 change nothing", "[appearance][device]") {
  for_each_stages([](Device& device, Stages& stages) {
    const Pictures p = pictures(45, 38, true);
    Pictures mapped = p;
    const std::vector<double> image(p.image.begin(), p.image.end()),
        seen = oracle::balanced_image(std::span(kBalance), image);
    std::ranges::copy(seen, mapped.image.begin());
    const Result got = run(device, stages, p, kFloats), plain = run(device, stages, mapped, {});
    CHECK(error(got.sums, plain.sums) < 1e-6);
    const std::vector<double> v_seen(plain.v_image.begin(), plain.v_image.end());
    const oracle::BalanceGradient want = oracle::balance_gradient(std::span(kBalance), image, v_seen);
    CHECK(error(got.v_image, want.image) < kImageError);
    CHECK(error(got.v_numbers, want.rows) < kNumbersError);
    const Result neutral = run(device, stages, p, std::vector<float>(12)), none = run(device, stages, p, {});
    CHECK(neutral.sums == none.sums);
    CHECK(neutral.v_image == none.v_image);
  });
}

// Each image has its own moments and number of steps of Adam. After each step, the mean of all images is
// subtracted from the numbers.
TEST_CASE("appearance: steps follow Adam, and the mean of the numbers over the images stays 0",
          "[appearance][device]") {
  constexpr std::size_t kImages = 5;
  for_each_stages([](Device& device, Stages& stages) {
    Buffer<float> state(device, "state", kImages * 60), gradient(device, "gradient", 24);
    Buffer<std::uint32_t> sentinel(device, "sentinel", 1);
    state.zero(), sentinel.zero();
    struct Own {
      Numbers value{}, first{}, second{}, steps{};
    };
    std::array<Own, kImages> want;
    std::mt19937 random(3);
    std::normal_distribution<float> noise(0.2f, 1);
    const auto step = [&](std::uint32_t image, std::uint32_t stamp, bool affine) {
      stages.appearance_step({.state = state.view(),
                              .images = kImages,
                              .image = image,
                              .gradient = gradient.view(),
                              .gradient_offset = 12,
                              .rate_diagonal = 0.05f,
                              .rate_other = affine ? 0.01f : 0.0f,
                              .sentinel = sentinel.view(),
                              .stamp = stamp});
    };
    for (const bool affine : {false, true})
      for (std::uint32_t i = 1; i <= 40; ++i) {
        const std::uint32_t image = i * i % kImages;
        std::vector<float> g(24, kNan);
        for (std::size_t q = 12; q < 24; ++q) g[q] = noise(random);
        gradient.upload(g);
        step(image, i, affine);
        Own& own = want[image];
        for (std::size_t q = 0; q < 12; ++q) {
          const bool diagonal = q % 5 == 0;
          if (!diagonal && !affine) continue;
          const double steps = ++own.steps[q];
          own.first[q] = 0.9 * own.first[q] + 0.1 * g[12 + q];
          own.second[q] = 0.999 * own.second[q] + 0.001 * g[12 + q] * g[12 + q];
          own.value[q] -= (diagonal ? 0.05 : 0.01) * own.first[q] / (1 - std::pow(0.9, steps)) /
                          std::sqrt(own.second[q] / (1 - std::pow(0.999, steps)));
          double mean = 0;
          for (const Own& o : want) mean += o.value[q] / kImages;
          for (Own& o : want) o.value[q] -= mean;
        }
      }
    const std::vector<float> got = state.download();
    double worst = 0;
    for (std::size_t q = 0; q < 12; ++q) {
      double mean = 0;
      for (std::size_t i = 0; i < kImages; ++i) {
        worst = std::max(worst, std::abs(got[60 * i + q] - want[i].value[q]));
        mean += got[60 * i + q];
      }
      CHECK(std::abs(mean) < 1e-6);
    }
    CHECK(worst < kStepError);

    // A step whose gradient is not finite changes nothing and writes its stamp to the sentinel. After that,
    // only steps with this stamp are executed.
    gradient.upload(std::vector<float>(24, kNan));
    step(2, 7, true);
    CHECK(state.download() == got);
    CHECK(sentinel.download()[0] == 7);
    gradient.upload(std::vector<float>(24, 1.0f));
    step(2, 8, true);
    CHECK(state.download() == got);
    step(2, 7, true);
    CHECK(state.download() != got);
  });
}

}  // namespace
