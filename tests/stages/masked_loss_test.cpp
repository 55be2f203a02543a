// SPDX-License-Identifier: Apache-2.0
// Tests masks in the stage ImageLoss. On every device, the loss is compared with a direct evaluation in
// double precision, and the gradient with difference quotients of this evaluation. Also tests that masked
// pixels have no influence, that a mask that keeps a rectangle gives the same loss as cropping, and the SSIM
// of masked images.
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <random>

#include "host/pipeline/image_metrics.hpp"
#include "host/pipeline/masked_metrics.hpp"
#include "tests/support/stages_fixture.hpp"

namespace {

using namespace ubs;
using test::for_each_stages;

struct Scene {
  int width, height;
  std::vector<float> image;  // planar, not padded
  std::vector<std::uint8_t> target, mask;
  std::size_t pixels() const { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }
};

Scene random_scene(int width, int height) {
  std::mt19937 random(7);
  std::normal_distribution<float> noise(0, 0.1f);
  Scene s{width, height, {}, {}, {}};
  for (int c = 0; c < 3; ++c)
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        const float value = 0.5f + 0.4f * std::sin(0.2f * static_cast<float>(x + 3 * c)) *
                                       std::cos(0.1f * static_cast<float>(y));
        s.target.push_back(static_cast<std::uint8_t>(std::lround(255 * value)));
        s.image.push_back(value + noise(random));
      }
  // The mask consists of a band, a disc, and single pixels.
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const bool masked = (y > 5 && y < 9) || std::hypot(x - 20, y - 20) < 7 || (x * 7 + y * 13) % 31 == 0;
      s.mask.push_back(masked ? 0 : 200);
    }
  return s;
}

// Returns (1 - lambda) mean |x - t| + lambda (1 - mean SSIM), where masked pixels are treated as if they were
// outside of the image.
double reference_loss(const Scene& s, const std::vector<double>& image, double lambda,
                      double* l1_out = nullptr, double* ssim_out = nullptr) {
  std::array<double, 11> w{};
  double total = 0;
  for (int k = -5; k <= 5; ++k) total += w[static_cast<std::size_t>(k + 5)] = std::exp(-k * k / 4.5);
  for (double& v : w) v /= total;
  double l1 = 0, ssim = 0, count = 0;
  for (std::size_t c = 0; c < 3; ++c)
    for (int y = 0; y < s.height; ++y)
      for (int x = 0; x < s.width; ++x) {
        const auto at = [&](int px, int py) { return static_cast<std::size_t>(py * s.width + px); };
        if (s.mask[at(x, y)] == 0) continue;
        double a = 0, b = 0, aa = 0, bb = 0, ab = 0;
        for (int j = -5; j <= 5; ++j)
          for (int i = -5; i <= 5; ++i) {
            const int px = x + i, py = y + j;
            if (px < 0 || py < 0 || px >= s.width || py >= s.height || s.mask[at(px, py)] == 0) continue;
            const double weight = w[static_cast<std::size_t>(i + 5)] * w[static_cast<std::size_t>(j + 5)];
            const double va = image[c * s.pixels() + at(px, py)],
                         vb = s.target[c * s.pixels() + at(px, py)] / 255.0;
            a += weight * va, b += weight * vb;
            aa += weight * va * va, bb += weight * vb * vb, ab += weight * va * vb;
          }
        ssim += (2 * a * b + 1e-4) * (2 * (ab - a * b) + 9e-4) /
                ((a * a + b * b + 1e-4) * (aa - a * a + bb - b * b + 9e-4));
        l1 += std::abs(image[c * s.pixels() + at(x, y)] - s.target[c * s.pixels() + at(x, y)] / 255.0);
        count += 1;
      }
  if (l1_out) *l1_out = l1 / count;
  if (ssim_out) *ssim_out = ssim / count;
  return (1 - lambda) * l1 / count + lambda * (1 - ssim / count);
}

struct MaskedResult {
  std::vector<float> sums, gradient;  // the gradient is planar and not padded
};

MaskedResult run(Device& device, Stages& stages, const Scene& s, bool masked, bool gradient = true) {
  const ImageShape shape{s.width, s.height};
  std::vector<float> padded(3 * shape.plane(), std::numeric_limits<float>::quiet_NaN());
  const auto place = [&](std::size_t i) {
    const std::size_t c = i / s.pixels(), y = i % s.pixels() / static_cast<std::size_t>(s.width);
    return c * shape.plane() + y * static_cast<std::size_t>(shape.pitch()) +
           i % static_cast<std::size_t>(s.width);
  };
  for (std::size_t i = 0; i < s.image.size(); ++i) padded[place(i)] = s.image[i];
  Buffer<float> image(device, "image", padded.size()), v_image(device, "gradient", padded.size()),
      sums(device, "sums", 8);
  Buffer<std::uint8_t> target(device, "target", s.target.size()), mask(device, "mask", s.mask.size());
  image.upload(padded), target.upload(s.target), mask.upload(s.mask);
  ImageLoss loss;
  loss.shape = shape;
  loss.image = image.view(), loss.target = target.view(), loss.sums = sums.view();
  if (gradient) loss.v_image = v_image.view();
  if (masked) {
    loss.mask = mask.view();
    loss.counted =
        static_cast<std::uint32_t>(s.pixels() - static_cast<std::size_t>(std::ranges::count(s.mask, 0)));
  }
  stages.image_loss(loss);
  MaskedResult result{sums.download(), std::vector<float>(gradient ? s.image.size() : 0)};
  if (!gradient) return result;
  const std::vector<float> all = v_image.download();
  for (std::size_t i = 0; i < s.image.size(); ++i) result.gradient[i] = all[place(i)];
  return result;
}

Scene cropped(const Scene& s, int x0, int y0, int width, int height) {
  Scene out{width, height, {}, {}, std::vector<std::uint8_t>(static_cast<std::size_t>(width * height), 255)};
  for (std::size_t c = 0; c < 3; ++c)
    for (int y = y0; y < y0 + height; ++y)
      for (int x = x0; x < x0 + width; ++x) {
        const std::size_t i = c * s.pixels() + static_cast<std::size_t>(y * s.width + x);
        out.image.push_back(s.image[i]), out.target.push_back(s.target[i]);
      }
  return out;
}

}  // namespace

TEST_CASE("masked image loss and gradient agree with the reference in double precision", "[loss][device]") {
  const Scene s = random_scene(45, 37);
  std::vector<double> image(s.image.begin(), s.image.end());
  double l1 = 0, ssim = 0;
  reference_loss(s, image, 0.2, &l1, &ssim);
  std::vector<std::pair<std::size_t, double>> slopes;
  double largest = 0;
  std::mt19937 random(3);
  for (int k = 0; k < 60; ++k) {
    const std::size_t i = random() % image.size();
    const double keep = image[i], h = 1e-6;
    image[i] = keep + h;
    const double above = reference_loss(s, image, 0.2);
    image[i] = keep - h;
    slopes.emplace_back(i, (above - reference_loss(s, image, 0.2)) / (2 * h));
    image[i] = keep;
    largest = std::max(largest, std::abs(slopes.back().second));
  }
  for_each_stages([&](Device& device, Stages& stages) {
    const MaskedResult result = run(device, stages, s, true);
    CHECK(result.sums[0] == Approx(l1).epsilon(0).margin(2e-8));  // the same bounds as in loss_test.cpp
    CHECK(result.sums[1] == Approx(ssim).epsilon(0).margin(3e-7));
    double worst = 0;
    std::size_t zeros = 0;
    for (const auto& [i, slope] : slopes) {
      worst = std::max(worst, std::abs(result.gradient[i] - slope) / largest);
      if (s.mask[i % s.pixels()] != 0) continue;
      REQUIRE(result.gradient[i] == 0);
      ++zeros;
    }
    CHECK(worst < 4e-5);
    CHECK(zeros > 5);
    CHECK(zeros < 40);
    CHECK(run(device, stages, s, true, false).sums == result.sums);
    CHECK(run(device, stages, s, false).sums[1] != result.sums[1]);
  });
}

TEST_CASE("masked pixels have no influence on the loss, even if they are NaN", "[loss][device]") {
  for_each_stages([](Device& device, Stages& stages) {
    const Scene s = random_scene(150, 40);
    Scene other = s;
    for (std::size_t i = 0; i < s.image.size(); ++i) {
      if (s.mask[i % s.pixels()] != 0) continue;
      other.image[i] = i % 2 ? std::numeric_limits<float>::quiet_NaN() : 1e30f;
      other.target[i] = static_cast<std::uint8_t>(i % 256);
    }
    const MaskedResult a = run(device, stages, s, true), b = run(device, stages, other, true);
    CHECK(a.sums == b.sums);
    CHECK(a.gradient == b.gradient);
    other.mask.assign(other.mask.size(), 0);
    const MaskedResult none = run(device, stages, other, true);
    CHECK(none.sums == std::vector<float>{0, 1, 0, 0, 0, 0, 0, 0});
    CHECK(none.gradient == std::vector<float>(none.gradient.size(), 0.0f));
  });
}

TEST_CASE("a mask that keeps a rectangle gives the same loss and gradient as cropping", "[loss][device]") {
  for_each_stages([](Device& device, Stages& stages) {
    Scene s = random_scene(90, 50);
    const int x0 = 13, y0 = 7, width = 60, height = 30;
    for (int y = 0; y < s.height; ++y)
      for (int x = 0; x < s.width; ++x)
        s.mask[static_cast<std::size_t>(y * s.width + x)] =
            x >= x0 && x < x0 + width && y >= y0 && y < y0 + height;
    const Scene crop = cropped(s, x0, y0, width, height);
    const MaskedResult masked = run(device, stages, s, true), alone = run(device, stages, crop, false);
    for (std::size_t k = 0; k < 5; ++k) CHECK(masked.sums[k] == Approx(alone.sums[k]).epsilon(1e-5));
    const Scene back = cropped({s.width, s.height, masked.gradient, s.target, s.mask}, x0, y0, width, height);
    double worst = 0, largest = 0;
    for (std::size_t i = 0; i < back.image.size(); ++i) {
      worst = std::max(worst, std::abs(double{back.image[i]} - alone.gradient[i]));
      largest = std::max(largest, std::abs(double{alone.gradient[i]}));
    }
    CHECK(worst / largest < 4e-5);
  });
}

TEST_CASE("the SSIM over windows inside the image skips windows with masked pixels", "[loss][device]") {
  Scene s = random_scene(40, 34);
  std::vector<float> target;
  for (const std::uint8_t v : s.target) target.push_back(static_cast<float>(v) / 255.0f);
  for (float& v : s.image) v = std::clamp(v, 0.0f, 1.0f);
  for (int y = 0; y < s.height; ++y)
    for (int x = 0; x < s.width; ++x) s.mask[static_cast<std::size_t>(y * s.width + x)] = x >= 9 && y >= 4;
  const Scene crop = cropped(s, 9, 4, 31, 30);
  const auto measured = masked_valid_ssim(s.image, target, s.mask, {s.width, s.height});
  REQUIRE(measured);
  for (const auto& device : devices_under_test()) {
    ImageMetrics metrics(*device, {});
    const ImageShape shape{crop.width, crop.height};
    std::vector<float> padded(3 * shape.plane());
    for (std::size_t i = 0; i < crop.image.size(); ++i)
      padded[i / crop.pixels() * shape.plane() +
             i % crop.pixels() / 31 * static_cast<std::size_t>(shape.pitch()) + i % 31] = crop.image[i];
    Buffer<float> image(*device, "image", padded.size());
    Buffer<std::uint8_t> bytes(*device, "target", crop.target.size());
    image.upload(padded), bytes.upload(crop.target);
    const auto expected = metrics.valid_ssim(
        {.size = {31, 30}, .bytes = {}, .values = image.view(), .pitch = shape.pitch(), .rows = shape.rows()},
        {.size = {31, 30}, .bytes = bytes.view(), .values = {}});
    REQUIRE(expected);
    CHECK(*measured == Approx(*expected).epsilon(0).margin(2e-6));
  }
  s.mask[static_cast<std::size_t>(20 * s.width + 20)] = 0;
  CHECK(*masked_valid_ssim(s.image, target, s.mask, {s.width, s.height}) != *measured);
  s.mask.assign(s.mask.size(), 0);
  CHECK(!masked_valid_ssim(s.image, target, s.mask, {s.width, s.height}));
  CHECK(fill_masked(s.image, target, s.mask) == target);
}
