// SPDX-License-Identifier: Apache-2.0
// Tests the stage ImageLoss on every device. Its values and its gradient are compared with a direct
// evaluation in double precision, in which pixels outside the image are 0. Also tests that the padding of the
// gradient is 0, targets of bytes and of floats, evaluation without a gradient, reproducibility, and images
// smaller than the SSIM window.
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <random>
#include <utility>
#include <vector>

#include "host/opencl/platform.hpp"
#include "tests/support/stages_fixture.hpp"

namespace {

using namespace ubs;
using test::for_each_stages;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

struct Images {
  int width, height;
  std::vector<float> image;  // planar, not padded
  std::vector<std::uint8_t> target;
};

// ---- Reference: the loss from five weighted means over windows; pixels outside the image are 0 ----

using Plane = std::vector<double>;

// Returns the means over the 11 x 11 Gaussian windows of SSIM.
Plane blur(const Plane& in, int width, int height) {
  std::array<double, 11> weights{};
  double sum = 0;
  for (int k = -5; k <= 5; ++k) sum += weights[k + 5] = std::exp(-k * k / 4.5);
  Plane rows(in.size(), 0.0), out(in.size(), 0.0);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int k = std::max(-5, -x); k <= std::min(5, width - 1 - x); ++k)
        rows[y * width + x] += weights[k + 5] / sum * in[y * width + x + k];
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int k = std::max(-5, -y); k <= std::min(5, height - 1 - y); ++k)
        out[y * width + x] += weights[k + 5] / sum * rows[(y + k) * width + x];
  return out;
}

Plane product(const Plane& a, const Plane& b) {
  Plane c(a.size());
  for (std::size_t i = 0; i < a.size(); ++i) c[i] = a[i] * b[i];
  return c;
}

struct ExactLoss {
  double l1 = 0, ssim = 0;
  std::array<double, 3> mse{};
  std::vector<double> gradient;  // planar, not padded
};

// Adds the loss and the gradient of one channel to `e`. The formulas and their notation are those of
// docs/method.md, section 4.1.
void add_channel(const Plane& x, const Plane& t, int width, int height, double lambda, int channel,
                 ExactLoss& e) {
  const Plane mu1 = blur(x, width, height), mu2 = blur(t, width, height);
  const Plane xx = blur(product(x, x), width, height), tt = blur(product(t, t), width, height);
  const Plane xt = blur(product(x, t), width, height);
  const double pixels = static_cast<double>(x.size()), values = 3 * pixels;
  Plane pm(x.size()), p1(x.size()), p12(x.size());
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double a = 2 * mu1[i] * mu2[i] + 1e-4, b = 2 * (xt[i] - mu1[i] * mu2[i]) + 9e-4;
    const double c = mu1[i] * mu1[i] + mu2[i] * mu2[i] + 1e-4;
    const double d = xx[i] - mu1[i] * mu1[i] + tt[i] - mu2[i] * mu2[i] + 9e-4;
    e.ssim += a * b / (c * d) / values;
    p12[i] = 2 * a / (c * d);
    p1[i] = -a * b / (c * d * d);
    pm[i] =
        2 * mu2[i] * b / (c * d) - 2 * mu1[i] * a * b / (c * c * d) - 2 * mu1[i] * p1[i] - mu2[i] * p12[i];
  }
  const Plane k_pm = blur(pm, width, height), k_p1 = blur(p1, width, height),
              k_p12 = blur(p12, width, height);
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double difference = x[i] - t[i];
    e.l1 += std::abs(difference) / values;
    e.mse[channel] += difference * difference / pixels;
    const double sign = (difference > 0) - (difference < 0);
    e.gradient.push_back((1 - lambda) * sign / values -
                         lambda * (k_pm[i] + 2 * x[i] * k_p1[i] + t[i] * k_p12[i]) / values);
  }
}

ExactLoss evaluate(const Images& images, double lambda, bool clamp = false) {
  ExactLoss e;
  const std::size_t pixels = static_cast<std::size_t>(images.width) * images.height;
  for (int c = 0; c < 3; ++c) {
    Plane x(pixels), t(pixels);
    for (std::size_t i = 0; i < pixels; ++i) {
      // The kernel uses the target in single precision, and equal pixels must stay equal.
      t[i] = static_cast<float>(images.target[c * pixels + i]) * 0.00392156862745098f;
      x[i] = images.image[c * pixels + i];
      if (clamp) x[i] = std::clamp(x[i], 0.0, 1.0);
    }
    add_channel(x, t, images.width, images.height, lambda, c, e);
  }
  return e;
}

// ---- Images ----

// Returns a render that is similar to its target: smooth shapes, noise, and values beyond [0, 1].
Images similar_images(int width, int height) {
  std::mt19937 random(static_cast<unsigned>(width * 1000 + height));
  std::normal_distribution<float> noise(0, 0.08f);
  Images images{width, height, {}, {}};
  for (int c = 0; c < 3; ++c)
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        const float value = 0.5f + 0.5f * std::sin(0.13f * static_cast<float>(x + c)) *
                                       std::cos(0.07f * static_cast<float>(y * (c + 1)));
        images.target.push_back(static_cast<std::uint8_t>(std::lround(255 * value)));
        images.image.push_back(value + noise(random));
      }
  return images;
}

Images constant_images(int width, int height, std::uint8_t target, float image) {
  const std::size_t values = 3ull * width * height;
  return {width, height, std::vector<float>(values, image), std::vector<std::uint8_t>(values, target)};
}

// ---- Running the stage ----

struct LossResult {
  std::vector<float> sums, gradient;  // the gradient includes the padding
};

struct RunOptions {
  bool gradient = true, clamp = false, float_target = false;
  float lambda = 0.2f, scale = 1;
};

LossResult run(Device& device, Stages& stages, const Images& images, const RunOptions& options) {
  const ImageShape shape{images.width, images.height};
  // The padding is undefined, so it is filled with NaN.
  std::vector<float> padded(3 * shape.plane(), kNan);
  for (int c = 0; c < 3; ++c)
    for (int y = 0; y < images.height; ++y)
      for (int x = 0; x < images.width; ++x)
        padded[c * shape.plane() + y * shape.pitch() + x] =
            images.image[(static_cast<std::size_t>(c) * images.height + y) * images.width + x];
  std::vector<float> target_values;
  for (const std::uint8_t value : images.target)
    target_values.push_back(static_cast<float>(value) * 0.00392156862745098f);

  Buffer<float> image(device, "image", padded.size()), gradient(device, "gradient", padded.size());
  Buffer<float> target_float(device, "target", target_values.size()), sums(device, "sums", 11);
  Buffer<std::uint8_t> target(device, "target", images.target.size());
  image.upload(padded);
  gradient.upload(std::vector<float>(padded.size(), kNan));
  sums.upload(std::vector<float>(11, -7.0f));
  target.upload(images.target);
  target_float.upload(target_values);
  ImageLoss loss;
  loss.shape = shape;
  loss.image = image.view();
  if (options.float_target)
    loss.target_float = target_float.view();
  else
    loss.target = target.view();
  loss.weights = loss_weights(options.lambda);
  loss.scale = options.scale;
  loss.clamp = options.clamp;
  if (options.gradient) loss.v_image = gradient.view();
  loss.sums = sums.view();
  loss.sums_offset = 2;
  stages.image_loss(loss);
  return {sums.download(), gradient.download()};
}

struct Tolerance {
  double l1, ssim, mse, gradient;  // `gradient` is relative to the largest element
};
// The bounds are about twice the largest errors observed on PoCL, with CPU and with GPU kernels: 8.4e-9 for
// L1, 1.4e-7 for SSIM, 2.5e-9 for the MSE, and 1.8e-5 for the gradient of an image of 33 x 50 pixels.
constexpr Tolerance kSimilar{2e-8, 3e-7, 5e-9, 3.6e-5};
// Bounds for constant images, where the rounding errors of all pixels are equal and do not cancel. The
// largest observed errors are 1.9e-7 for L1, 3.0e-6 for SSIM, 2.5e-8 for the MSE, and 3.7e-4 for the
// gradient, if the images differ by only 1e-3.
constexpr Tolerance kConstant{4e-7, 6e-6, 5e-8, 7e-4};

void check_sums(const std::vector<float>& sums, const ExactLoss& expected, const Tolerance& tolerance) {
  const auto near = [](double value, double margin) { return Approx(value).epsilon(0).margin(margin); };
  CHECK(sums[2] == near(expected.l1, tolerance.l1));
  CHECK(sums[3] == near(expected.ssim, tolerance.ssim));
  for (int c = 0; c < 3; ++c) CHECK(sums[4 + c] == near(expected.mse[c], tolerance.mse));
  for (const int i : {7, 8, 9}) CHECK(sums[i] == 0);
  for (const int i : {0, 1, 10}) CHECK(sums[i] == -7.0f);  // values outside the 8 sums are not changed
}

// Returns the error of the gradient relative to its largest element, and checks that the padding is zero.
double gradient_error(const Images& images, const std::vector<float>& gradient, const ExactLoss& expected,
                      float scale) {
  const ImageShape shape{images.width, images.height};
  double worst = 0, largest = 0;
  for (int c = 0; c < 3; ++c)
    for (int y = 0; y < shape.rows(); ++y)
      for (int x = 0; x < shape.pitch(); ++x) {
        const float got = gradient[c * shape.plane() + y * shape.pitch() + x];
        if (x >= images.width || y >= images.height) {
          REQUIRE(got == 0);
          continue;
        }
        const double want =
            scale * expected.gradient[(static_cast<std::size_t>(c) * images.height + y) * images.width + x];
        REQUIRE(std::isfinite(got));
        worst = std::max(worst, std::abs(got - want));
        largest = std::max(largest, std::abs(want));
      }
  return worst / largest;
}

constexpr std::pair<int, int> kSizes[] = {{1, 1}, {7, 5}, {16, 16}, {17, 33}, {200, 120}};

}  // namespace

TEST_CASE("image loss and gradient agree with the reference in double precision", "[loss][device]") {
  for_each_stages([](Device& device, Stages& stages) {
    for (const auto& [width, height] : kSizes) {
      INFO(width << " x " << height);
      const Images images = similar_images(width, height);
      const RunOptions options{.scale = 0.25f};
      const ExactLoss expected = evaluate(images, 0.2);
      const LossResult result = run(device, stages, images, options);
      check_sums(result.sums, expected, kSimilar);
      CHECK(gradient_error(images, result.gradient, expected, options.scale) < kSimilar.gradient);
    }
  });
}

// Images of up to 256 x 256 pixels need a single launch, and larger ones need a launch per channel. Both are
// tested, with sizes that are not multiples of the vector width.
TEST_CASE("image loss agrees with the reference at every vector width", "[loss][device]") {
  const std::vector<DeviceInfo> devices = opencl::list_devices();
  for (std::size_t i = 0; i < devices.size(); ++i)
    for (const unsigned lanes : {4u, 8u, 16u}) {
      if (devices[i].float_vector_width == 1) continue;
      const auto device = opencl::open_device(i, lanes);
      const auto stages = make_stages(*device, {});
      for (const auto& [width, height] : {std::pair{45, 38}, {117, 21}, {301, 230}}) {
        INFO(lanes << " lanes, " << width << " x " << height);
        const Images images = similar_images(width, height);
        const ExactLoss expected = evaluate(images, 0.2);
        const LossResult result = run(*device, *stages, images, {});
        check_sums(result.sums, expected, kSimilar);
        CHECK(gradient_error(images, result.gradient, expected, 1) < kSimilar.gradient);
      }
    }
}

TEST_CASE("image loss of constant images is exact if they are equal, and otherwise agrees with the reference",
          "[loss][device]") {
  for_each_stages([](Device& device, Stages& stages) {
    for (const int value : {0, 128, 255})
      for (const float offset : {0.0f, 1e-3f, -0.2f}) {
        INFO("target " << value << ", offset " << offset);
        const float base = static_cast<float>(value) * 0.00392156862745098f;
        const Images images = constant_images(35, 20, static_cast<std::uint8_t>(value), base + offset);
        const ExactLoss expected = evaluate(images, 1.0);
        const LossResult result = run(device, stages, images, {.lambda = 1.0f});
        check_sums(result.sums, expected, kConstant);
        if (offset == 0) {
          CHECK(result.sums[3] == 1.0f);
          for (const float v : result.gradient) REQUIRE(v == 0);
        } else {
          CHECK(gradient_error(images, result.gradient, expected, 1) < kConstant.gradient);
        }
      }
  });
}

TEST_CASE("image loss accepts a float target and does not write the gradient in evaluation",
          "[loss][device]") {
  for_each_stages([](Device& device, Stages& stages) {
    const Images images = similar_images(45, 37);
    const LossResult bytes = run(device, stages, images, {});
    const LossResult floats = run(device, stages, images, {.float_target = true});
    CHECK(bytes.sums == floats.sums);
    CHECK(bytes.gradient == floats.gradient);

    const LossResult evaluation = run(device, stages, images, {.gradient = false, .clamp = true});
    check_sums(evaluation.sums, evaluate(images, 0.2, true), kSimilar);
    CHECK(std::all_of(evaluation.gradient.begin(), evaluation.gradient.end(),
                      [](float v) { return std::isnan(v); }));
    const LossResult unclamped = run(device, stages, images, {.gradient = false});
    CHECK(unclamped.sums == bytes.sums);
    CHECK(unclamped.sums[2] != evaluation.sums[2]);
  });
}

TEST_CASE("image loss is reproducible, also after other image sizes", "[loss][device]") {
  for_each_stages([](Device& device, Stages& stages) {
    const Images large = similar_images(200, 120), small = similar_images(33, 50);
    const LossResult first = run(device, stages, large, {});
    run(device, stages, small, {});
    const LossResult second = run(device, stages, large, {});
    CHECK(first.sums == second.sums);
    CHECK(first.gradient == second.gradient);
    CHECK(gradient_error(small, run(device, stages, small, {}).gradient, evaluate(small, 0.2), 1) <
          kSimilar.gradient);
    // With other image sizes, the margins are at other positions of the same buffers.
    for (const auto& [width, height] : {std::pair{300, 40}, {20, 300}, {300, 40}}) {
      const Images other = similar_images(width, height);
      CHECK(gradient_error(other, run(device, stages, other, {}).gradient, evaluate(other, 0.2), 1) <
            kSimilar.gradient);
    }
  });
}

TEST_CASE("image loss is finite for pixel values far outside the range from 0 to 1", "[loss][device]") {
  for_each_stages([](Device& device, Stages& stages) {
    for (const float value : {1e3f, -1e6f, 1e12f}) {
      Images images = similar_images(40, 40);
      for (float& x : images.image) x *= value;
      const LossResult result = run(device, stages, images, {});
      for (const float v : result.sums) CHECK(std::isfinite(v));
      for (const float v : result.gradient) REQUIRE(std::isfinite(v));
    }
  });
}
