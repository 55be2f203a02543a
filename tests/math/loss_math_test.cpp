// SPDX-License-Identifier: Apache-2.0
// Tests kernels/math/loss.h in double precision. Compares the SSIM of one window with the textbook formula,
// and the gradient of the whole loss with central differences. For the differences, the loss is computed
// directly from the textbook formula, with zeros outside of the image.
// clang-format off
#include <catch2/catch.hpp>

#include <cmath>
#include <random>
#include <utility>
#include <vector>

// Each of these headers needs the headers before it.
#include "kernels/dialect/dialect.h"
#include "kernels/loss_weights.h"
#include "kernels/math/loss.h"
// clang-format on

namespace {

constexpr int kWidth = 13, kHeight = 9;
using Plane = std::vector<double>;

double window(int dx, int dy) {
  if (std::abs(dx) > 5 || std::abs(dy) > 5) return 0;
  double sum = 0;
  for (int k = -5; k <= 5; ++k) sum += std::exp(-k * k / 4.5);
  return std::exp(-(dx * dx + dy * dy) / 4.5) / (sum * sum);
}

// Returns the SSIM of the textbook formula, from the five window means of x, t, x^2, t^2 and x t.
double textbook(double x, double t, double xx, double tt, double xt) {
  return (2 * x * t + 1e-4) * (2 * (xt - x * t) + 9e-4) /
         ((x * x + t * t + 1e-4) * (xx - x * x + tt - t * t + 9e-4));
}

// Returns the weighted mean of f(i) over the window at (px, py), where i is the index of a pixel. f counts as
// zero outside of the image.
template <class F>
double blur(int px, int py, const F& f) {
  double sum = 0;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) sum += window(x - px, y - py) * f(y * kWidth + x);
  return sum;
}

double textbook_at(const Plane& x, const Plane& t, int px, int py) {
  return textbook(blur(px, py, [&](int i) { return x[i]; }), blur(px, py, [&](int i) { return t[i]; }),
                  blur(px, py, [&](int i) { return x[i] * x[i]; }),
                  blur(px, py, [&](int i) { return t[i] * t[i]; }),
                  blur(px, py, [&](int i) { return x[i] * t[i]; }));
}

double loss(const Plane& x, const Plane& t, double lambda) {
  double l1 = 0, ssim = 0;
  for (int y = 0; y < kHeight; ++y)
    for (int px = 0; px < kWidth; ++px) {
      l1 += std::abs(x[y * kWidth + px] - t[y * kWidth + px]);
      ssim += textbook_at(x, t, px, y);
    }
  const double n = kWidth * kHeight;
  return (1 - lambda) * l1 / n + lambda * (1 - ssim / n);
}

SsimPoint point_at(const Plane& x, const Plane& t, int px, int py, double shift) {
  SsimMeans m;
  // Outside of the image x = t = 0, so u is -2 shift there. The weights of a window add up to 1.
  const double inside = blur(px, py, [](int) { return 1.0; });
  const auto u = [&](int i) { return x[i] + t[i] - 2 * shift; };
  const auto v = [&](int i) { return x[i] - t[i]; };
  m.u = blur(px, py, u) - 2 * shift * (1 - inside);
  m.v = blur(px, py, v);
  m.uu = blur(px, py, [&](int i) { return u(i) * u(i); }) + 4 * shift * shift * (1 - inside);
  m.vv = blur(px, py, [&](int i) { return v(i) * v(i); });
  return ssim_point(m, shift);
}

struct Images {
  Plane x, t;
};

Images random_images(double low, double high) {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> uniform(low, high);
  Images images{Plane(kWidth * kHeight), Plane(kWidth * kHeight)};
  for (double& value : images.x) value = uniform(random);
  for (double& value : images.t) value = uniform(random);
  return images;
}

}  // namespace

TEST_CASE("the weights of the SSIM window are a normalised Gaussian with a sigma of 1.5 pixels", "[loss]") {
  const double weights[kSsimTaps] = UBS_SSIM_WEIGHTS;
  double sum = 0;
  for (int k = -5; k <= 5; ++k) sum += std::exp(-k * k / (2 * 1.5 * 1.5));
  for (int k = -5; k <= 5; ++k) CHECK(weights[k + 5] == Approx(std::exp(-k * k / 4.5) / sum).epsilon(1e-14));
  CHECK(weights[0] == Approx(0.001028380).epsilon(1e-6));  // the two values are those of method.md 4.1
  CHECK(weights[5] == Approx(0.266011715).epsilon(1e-6));
}

TEST_CASE("the SSIM of a window agrees with the textbook formula, whatever is subtracted from the colours",
          "[loss]") {
  const Images images = random_images(-0.2, 1.3);
  for (const double shift : {0.0, 0.5, 1.0})
    for (int y = 0; y < kHeight; y += 2)
      for (int x = 0; x < kWidth; x += 3)
        CHECK(1 - point_at(images.x, images.t, x, y, shift).dissimilarity ==
              Approx(textbook_at(images.x, images.t, x, y)).epsilon(1e-11));
}

TEST_CASE("the gradient of the loss matches central differences", "[loss]") {
  const auto [low, high] = GENERATE(std::pair{0.0, 1.0}, std::pair{0.45, 0.5}, std::pair{-1.0, 3.0});
  const Images images = random_images(low, high);
  std::vector<SsimPoint> points;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) points.push_back(point_at(images.x, images.t, x, y, 0.25));

  constexpr double kLambda = 0.25, kCount = kWidth * kHeight, kStep = 1e-6;
  for (int y = 0; y < kHeight; ++y)
    for (int px = y % 2; px < kWidth; px += 2) {
      const int i = y * kWidth + px;
      const double gradient =
          image_loss_vjp({0.75f, 0.25f}, images.x[i] + images.t[i], images.x[i] - images.t[i],
                         blur(px, y, [&](int j) { return points[j].mean; }),
                         blur(px, y, [&](int j) { return points[j].square_u; }),
                         blur(px, y, [&](int j) { return points[j].square_v; })) /
          kCount;
      Plane plus = images.x, minus = images.x;
      plus[i] += kStep, minus[i] -= kStep;
      const double difference =
          (loss(plus, images.t, kLambda) - loss(minus, images.t, kLambda)) / (2 * kStep);
      // The largest absolute error observed is 1.5e-10. The largest relative error observed is 2.8e-8, for a
      // gradient of 0.007. These are rounding errors of the differences.
      REQUIRE(gradient == Approx(difference).epsilon(5e-8).margin(3e-10));
    }
}

TEST_CASE("if both images are equal, the dissimilarity and the gradient are zero", "[loss]") {
  const Images images = random_images(0, 1);
  const SsimPoint p = point_at(images.x, images.x, 4, 4, 0.5);
  CHECK(p.dissimilarity == 0);
  CHECK(p.square_u == 0);
  CHECK(image_loss_vjp({0.8f, 0.2f}, 1.0, 0.0, 0.0, 0.0, p.square_v) == 0);
}

TEST_CASE("a variance that rounding has made negative does not make the loss infinite", "[loss]") {
  const SsimPoint p = ssim_point({2.0, 0.0, 4.0 - 1e-3, 0.0}, 0.0);
  CHECK(std::isfinite(p.dissimilarity));
  CHECK(std::isfinite(p.mean));
  CHECK(std::isfinite(p.square_v));
}
