// SPDX-License-Identifier: Apache-2.0
// This file contains the stress tests (row.hpp) of the stages that are not part of the renderer: the loss,
// Adam, relocation and growth, and noise.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cfloat>
#include <cmath>
#include <limits>

#include "host/base/error.hpp"
#include "host/lab/oracle/oracle_stages.hpp"
#include "host/lab/oracle/scenes.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/renderer.hpp"
#include "tests/stress/row.hpp"

namespace ubs::stress {
namespace {

// ---- The loss ----

struct LossResult {
  float l1 = 0, ssim = 0;
  std::vector<double> gradient;  // (3, H, W)
  bool finite = true;
};

LossResult device_loss(DeviceRunner& runner, int width, int height, const std::vector<float>& image,
                       const std::vector<float>& target, LossWeights weights) {
  Device& device = runner.device();
  const ImageShape shape{width, height};
  const std::vector<float> padded = padded_planes(image, shape);
  Buffer<float> on_device(device, "image", padded.size()), v_image(device, "image gradient", padded.size());
  Buffer<float> targets(device, "target", target.size()), sums(device, "loss sums", 8);
  on_device.upload(padded), targets.upload(target);
  runner.stages(3).image_loss({.shape = shape,
                               .image = on_device.view(),
                               .target = {},
                               .target_float = targets.view(),
                               .weights = weights,
                               .v_image = v_image.view(),
                               .sums = sums.view()});
  const std::vector<float> values = sums.download(), g = cropped_planes(v_image.download(), shape);
  const bool finite = std::isfinite(values[0]) && std::isfinite(values[1]) &&
                      std::ranges::all_of(g, [](float v) { return std::isfinite(v); });
  return {values[0], values[1], {g.begin(), g.end()}, finite};
}

std::vector<float> random_image(int width, int height, std::uint64_t seed, double low, double high) {
  Random random(seed);
  std::vector<float> image(3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  for (float& v : image) v = static_cast<float>(random.uniform(low, high));
  return image;
}

double distance(const std::vector<double>& a, const std::vector<double>& b) {
  double difference = 0, size = 0;
  for (std::size_t i = 0; i < b.size(); ++i) difference += (a[i] - b[i]) * (a[i] - b[i]), size += b[i] * b[i];
  return difference == 0 ? 0 : std::sqrt(difference / std::max(size, 1e-30));
}

void compare_loss(Row& row, int width, int height, const std::vector<float>& image,
                  const std::vector<float>& target) {
  const LossWeights weights = loss_weights(0.2f);
  const LossResult actual = device_loss(row.runner(), width, height, image, target, weights);
  INFO(width << "x" << height);
  CHECK(actual.finite);
  const std::vector<double> a(image.begin(), image.end()), b(target.begin(), target.end());
  const double ssim = oracle::ssim(a, b, 3, height, width);
  const std::vector<double> g = oracle::image_gradient(a, b, width, height, weights);
  row.check_error(std::abs(actual.ssim - ssim), "SSIM");
  row.check_error(distance(actual.gradient, g), "gradient of the loss");
}

TEST_CASE_METHOD(Row, "loss: images of 1x1 to 40x1 pixels, constant, equal, or with values outside 0 to 1",
                 "[stage]") {
  constexpr int kSizes[][2] = {{1, 1}, {3, 3}, {10, 10}, {11, 11}, {12, 7}, {40, 1}, {1, 40}, {33, 17}};
  for (const auto& s : kSizes) {
    const int w = s[0], h = s[1];
    const std::vector<float> noise = random_image(w, h, 1, 0, 1), other = random_image(w, h, 2, 0, 1);
    const std::vector<float> black(noise.size(), 0.0f), grey(noise.size(), 0.5f), white(noise.size(), 1.0f);
    compare_loss(*this, w, h, noise, other);
    compare_loss(*this, w, h, black, black);
    compare_loss(*this, w, h, grey, grey);
    compare_loss(*this, w, h, black, white);
    compare_loss(*this, w, h, noise, black);
    compare_loss(*this, w, h, random_image(w, h, 3, -3, 5), other);
  }
}

// ---- Adam ----

struct AdamResult {
  float param, moment1, moment2;
};

std::vector<AdamResult> device_adam(DeviceRunner& runner, const std::vector<float>& gradients, float start,
                                    std::uint64_t step) {
  Device& device = runner.device();
  SplatModel model(3, gradients.size());
  std::ranges::fill(model.values, start);
  DeviceModel on_device(device, model);
  const std::size_t size = static_cast<std::size_t>(on_device.rows()) * on_device.stride();
  Buffer<float> v(device, "gradients", size), m1(device, "first moments", size),
      m2(device, "second moments", size);
  Buffer<float> rates(device, "learning rates", static_cast<std::size_t>(on_device.rows()));
  v.zero(), m1.zero(), m2.zero();
  rates.upload(std::vector<float>(rates.size(), 0.01f));
  v.upload(gradients);
  runner.stages(3).adam({.splats = on_device.view(),
                         .v_params = v.view(),
                         .moment1 = m1.view(),
                         .moment2 = m2.view(),
                         .learning_rates = rates.view(),
                         .step = step});
  const SplatModel after = on_device.download();
  const std::vector<float> a = m1.download(), b = m2.download();
  std::vector<AdamResult> result;
  for (std::size_t i = 0; i < gradients.size(); ++i) result.push_back({after.row(0)[i], a[i], b[i]});
  return result;
}

// For gradients of up to 1e19, steps must agree with double precision. Steps are nearly 0 for gradients that
// are much smaller than epsilon = 1e-15. For gradients above 1.8e19, whose squares are infinite, the
// parameters must remain finite.
TEST_CASE_METHOD(Row, "Adam: gradients from 1e-45 to 3e38, and step numbers from 1 to 1e10", "[stage]") {
  std::vector<float> gradients{0.0f, -0.0f, 1e-45f, -1e-42f, 1e19f};
  for (int e = -37; e <= 18; ++e)
    gradients.push_back(std::pow(10.0f, static_cast<float>(e)) * (e % 2 ? 1.0f : -1.0f));
  for (const std::uint64_t step :
       {std::uint64_t{1}, std::uint64_t{2}, std::uint64_t{1000}, std::uint64_t{100000},
        std::uint64_t{10000000}, std::uint64_t{10000000000}}) {
    const std::vector<AdamResult> actual = device_adam(runner(), gradients, 0, step);
    for (std::size_t i = 0; i < gradients.size(); ++i) {
      const double g = gradients[i], beta1 = 0.9f, beta2 = 0.999f;
      const double bias1 = 1 - std::pow(beta1, static_cast<double>(step)),
                   bias2 = 1 - std::pow(beta2, static_cast<double>(step));
      const double m = (1 - beta1) * g, v = (1 - beta2) * g * g;
      const auto step_with = [&](double square) {
        return -0.01f * (m / bias1) / (std::sqrt(square / bias2) + 1e-15);
      };
      // A denormal second moment may be flushed to 0.
      const double expected = step_with(v), other = v < FLT_MIN ? step_with(0) : expected;
      const double error = std::min(std::abs(actual[i].param - expected), std::abs(actual[i].param - other));
      INFO("gradient " << gradients[i] << " at step " << step);
      CHECK(std::isfinite(actual[i].param));
      CHECK(std::isfinite(actual[i].moment1));
      CHECK(std::isfinite(actual[i].moment2));
      // The error of very small steps is not compared with their size, but with 1e-7, because they may be
      // exactly 0 if denormal numbers are flushed to 0.
      check_error(error / std::max(std::abs(expected), 1e-7), "step");
    }
  }
  for (const AdamResult& r : device_adam(runner(), {3e38f, -3e38f, 1e20f}, 1, 1))
    CHECK(std::isfinite(r.param));
}

// ---- Relocation and growth ----

struct Population {
  Population(Device& device, const std::vector<float>& opacities, std::size_t capacity)
      : model(make(opacities)),
        on_device(device, model, capacity),
        m1(device, "first moments", rows()),
        m2(device, "second moments", rows()) {
    m1.zero(), m2.zero();
  }
  static SplatModel make(const std::vector<float>& opacities) {
    Case c = row_case("population", 3, opacities.size());
    std::ranges::copy(opacities, c.model.row(c.model.layout().opacity).begin());
    return c.model;
  }
  std::size_t rows() const { return static_cast<std::size_t>(on_device.rows()) * on_device.stride(); }
  SplatModel model;
  DeviceModel on_device;
  Buffer<float> m1, m2;
};

std::uint32_t relocate(DeviceRunner& runner, Population& p) {
  return runner.stages(3).relocate({.splats = p.on_device.view(),
                                    .moment1 = p.m1.view(),
                                    .moment2 = p.m2.view(),
                                    .seed = 1,
                                    .iteration = 600});
}

void check_relocation(Row& row, const std::string& what, const std::vector<float>& opacities,
                      std::uint32_t expected) {
  INFO(what);
  Population p(row.device(), opacities, opacities.size());
  CHECK(relocate(row.runner(), p) == expected);
  if (expected == 0) return;
  const SplatModel after = p.on_device.download();
  for (const float raw : after.row(after.layout().opacity)) {
    CHECK(std::isfinite(raw));
    CHECK(sigmoid(raw) >= 0.00499);
  }
}

TEST_CASE_METHOD(Row, "relocation: all splats dead, alive or opaque, opacities of NaN, 999 copies of a splat",
                 "[stage]") {
  const float inf = std::numeric_limits<float>::infinity(), dead = -9;
  check_relocation(*this, "all dead", std::vector<float>(50, dead), 0);
  check_relocation(*this, "all alive", std::vector<float>(50, 1.0f), 0);
  check_relocation(*this, "all opaque", std::vector<float>(50, inf), 0);
  std::vector<float> one(1000, dead);
  one[500] = 20;
  check_relocation(*this, "999 copies of one opaque splat", one, 999);
  check_relocation(*this, "NaN is dead", {1.0f, NAN, 2.0f, -inf}, 2);
  check_relocation(*this, "only NaN", {NAN, NAN}, 0);

  // If a splat with the opacity o gets n copies, the new opacity o' of all of them satisfies (1 - o')^(n + 1)
  // = 1 - o, but is at least 0.005.
  for (const std::uint32_t copies : {1u, 5u, 200u}) {
    std::vector<float> opacities(copies + 1, dead);
    opacities[0] = 4;
    Population p(device(), opacities, opacities.size());
    relocate(runner(), p);
    const SplatModel after = p.on_device.download();
    const double parts = static_cast<double>(copies) + 1;
    const double expected = std::max(0.005, 1 - std::exp(std::log1p(-sigmoid(4)) / parts));
    for (const float raw : after.row(after.layout().opacity))
      check_error(std::abs(sigmoid(raw) - expected) / expected, "opacity after relocation");
  }
}

TEST_CASE_METHOD(Row, "growth: from one splat, from opaque splats, and with opacities of NaN", "[stage]") {
  const float inf = std::numeric_limits<float>::infinity();
  for (const auto& [what, opacities] : {std::pair<std::string, std::vector<float>>{"one", {3.0f}},
                                        {"opaque", {inf, 100.0f}},
                                        {"NaN among others", {NAN, 1.0f, -inf}}}) {
    INFO(what);
    Population p(device(), opacities, 64);
    runner().stages(3).grow({.splats = p.on_device.view(),
                             .target = 64,
                             .moment1 = p.m1.view(),
                             .moment2 = p.m2.view(),
                             .seed = 2,
                             .iteration = 600});
    p.on_device.set_count(64);
    const SplatModel after = p.on_device.download();
    for (std::size_t i = opacities.size(); i < 64; ++i)
      CHECK(std::isfinite(after.row(after.layout().opacity)[i]));
  }
}

// ---- Noise ----

// The displacement d satisfies |d| <= amount |Sigma_x| |n|, where n is a vector of three normal random
// numbers. These are at most 6.77, because they are made from 32-bit words with the method of Box and Muller.
// The test uses 6.7 instead. This is sufficient, because 3 scale^2, which the test uses for |Sigma_x|, is
// larger than |Sigma_x|.
TEST_CASE_METHOD(Row, "noise: covariances from 1e-14 to 1e60 with ratios of up to 1e14", "[stage]") {
  for (const double scale : {1e-7, 1e-3, 1.0, 1e4, 1e18, 1e30})
    for (const double thin : {1.0, 1e-7}) {
      Case c = row_case("noise", 3, 64);
      for (std::size_t i = 0; i < 64; ++i) {
        SplatPlan plan;
        plan.position = {0, 0, 0}, plan.scale = {scale, scale * thin, scale}, plan.opacity_raw = -20,
        plan.omega = 0.5;
        put_splat(c, i, plan);
      }
      DeviceModel model(device(), c.model);
      const double amount = 1e-3;
      runner().stages(3).add_noise(
          {.splats = model.view(), .amount = static_cast<float>(amount), .seed = 3, .iteration = 5});
      const SplatModel after = model.download();
      INFO("scales " << scale << " and " << scale * thin);
      const double largest = amount * 3 * scale * scale * 6.7 * std::sqrt(3.0);
      double moved = 0;
      for (int row = 0; row < 3; ++row)
        for (const float x : after.row(row)) {
          CHECK(std::isfinite(x));
          CHECK(std::abs(x) <= largest);
          moved = std::max<double>(moved, std::abs(x));
        }
      if (scale == 1) CHECK(moved > 0);
      if (scale > 1e29) CHECK(moved == 0);  // a displacement that exceeds single precision is skipped
    }
}

}  // namespace
}  // namespace ubs::stress
