// SPDX-License-Identifier: Apache-2.0
// Compares results of the stages DrawSky, SkyGradient and SkyStep on every device with results in double
// precision.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>

#include "host/lab/oracle/variant_formula.hpp"
#include "host/scene/camera.hpp"
#include "kernels/layout.h"
#include "tests/support/stages_fixture.hpp"

namespace {

using namespace ubs;
using test::for_each_stages;
using test::uploaded;

constexpr std::size_t kNumbers = kSkyNumbers;
// The bounds are twice the largest errors observed on PoCL and with the CUDA back end on the host: 2.5e-7 for
// pixels, 1.5e-7 for the gradient (relative to the sum of the absolute values of its terms), and 2.1e-7 for
// steps.
constexpr double kPixelError = 5e-7, kGradientError = 3e-7, kStepError = 4.2e-7;

// Returns the values of the nine functions of the sky for the direction of a pixel: 1, and the spherical
// harmonics of degrees 1 and 2.
std::vector<double> functions_at(const Camera& camera, int x, int y) {
  const std::array<double, 3> seen{(x + 0.5 - camera.cx) / camera.fx, (y + 0.5 - camera.cy) / camera.fy, 1};
  const double length = std::hypot(seen[0], seen[1], seen[2]);
  std::array<double, 3> direction{};
  for (std::size_t k = 0; k < 3; ++k)
    for (std::size_t j = 0; j < 3; ++j) direction[k] += camera.rotation[3 * j + k] * seen[j] / length;
  std::vector<double> functions = oracle::spherical_harmonics(direction, 9);
  functions[0] = 1;
  return functions;
}

struct Picture {
  Camera camera;
  ImageShape shape;
  // `sky` contains the coefficients. The others are planes with padding, as on the device. The padding of
  // transmittance and image is NaN, and that of v_image is 0.
  std::vector<float> sky, transmittance, image, v_image;
  std::size_t at(int c, int x, int y) const {
    return static_cast<std::size_t>(c) * shape.plane() +
           static_cast<std::size_t>(y) * static_cast<std::size_t>(shape.pitch()) +
           static_cast<std::size_t>(x);
  }
  template <typename F>
  void for_pixels(const F& f) const {
    for (int y = 0; y < shape.height; ++y)
      for (int x = 0; x < shape.width; ++x) f(x, y);
  }
};

Picture picture(int width, int height) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  std::mt19937 random(static_cast<unsigned>(131 * width + height));
  std::uniform_real_distribution<float> uniform(0, 1);
  std::normal_distribution<float> normal;
  Picture p;
  p.shape = {width, height};
  p.camera.width = width, p.camera.height = height;
  p.camera.fx = 0.9 * width, p.camera.fy = 1.2 * height;
  p.camera.cx = 0.45 * width, p.camera.cy = 0.6 * height;
  // The camera is rotated about two axes.
  const double a = 0.7, b = -0.4;
  p.camera.rotation = {std::cos(a),
                       0,
                       std::sin(a),
                       std::sin(b) * std::sin(a),
                       std::cos(b),
                       -std::sin(b) * std::cos(a),
                       -std::cos(b) * std::sin(a),
                       std::sin(b),
                       std::cos(b) * std::cos(a)};
  for (std::size_t q = 0; q < kNumbers; ++q) p.sky.push_back(0.4f * normal(random));
  p.transmittance.assign(p.shape.plane(), kNan);
  p.image.assign(3 * p.shape.plane(), kNan);
  p.v_image.assign(3 * p.shape.plane(), 0.0f);
  p.for_pixels([&](int x, int y) {
    p.transmittance[p.at(0, x, y)] = uniform(random);
    for (int c = 0; c < 3; ++c)
      p.image[p.at(c, x, y)] = uniform(random), p.v_image[p.at(c, x, y)] = normal(random);
  });
  return p;
}

// Returns the values of two cameras as the stages expect them. The second one is the given camera, and the
// first one must not be used.
std::vector<float> camera_rows(const Camera& camera) {
  std::vector<float> rows(2 * kCameraStride, 1e30f);
  float* const row = rows.data() + kCameraStride;
  for (std::size_t i = 0; i < 9; ++i) row[kCameraRotation + i] = static_cast<float>(camera.rotation[i]);
  row[kCameraFocal] = static_cast<float>(camera.fx), row[kCameraFocal + 1] = static_cast<float>(camera.fy);
  row[kCameraPrincipal] = static_cast<float>(camera.cx),
  row[kCameraPrincipal + 1] = static_cast<float>(camera.cy);
  return rows;
}

TEST_CASE("sky: pixels and the gradient of its coefficients agree with double precision", "[sky][device]") {
  for_each_stages([](Device& device, Stages& stages) {
    for (const auto& [width, height] : {std::pair{5, 3}, {16, 16}, {33, 50}, {117, 70}}) {
      INFO(width << " x " << height);
      const Picture p = picture(width, height);
      const Buffer<float> cameras = uploaded(device, camera_rows(p.camera)), sky = uploaded(device, p.sky),
                          transmittance = uploaded(device, p.transmittance),
                          image = uploaded(device, p.image), v_image = uploaded(device, p.v_image),
                          gradient = uploaded(device, std::vector<float>(kNumbers + 3, -7.0f));
      stages.draw_sky({p.shape, cameras.view(), 1, sky.view(), transmittance.view(), image.view()});
      stages.sky_gradient(
          {p.shape, cameras.view(), 1, transmittance.view(), v_image.view(), gradient.view(), 2});
      const std::vector<float> drawn = image.download(), got = gradient.download();
      std::array<double, kNumbers> want{}, size{};
      double worst = 0;
      p.for_pixels([&](int x, int y) {
        const std::vector<double> functions = functions_at(p.camera, x, y);
        const double left = p.transmittance[p.at(0, x, y)];
        for (int c = 0; c < 3; ++c) {
          double colour = 0;
          for (std::size_t k = 0; k < 9; ++k) {
            const std::size_t q = 3 * k + static_cast<std::size_t>(c);
            colour += p.sky[q] * functions[k];
            const double part = left * p.v_image[p.at(c, x, y)] * functions[k];
            want[q] += part, size[q] += std::abs(part);
          }
          const double expected = p.image[p.at(c, x, y)] + left * colour;
          worst = std::max(worst, std::abs(drawn[p.at(c, x, y)] - expected));
        }
      });
      CHECK(worst < kPixelError);
      for (std::size_t q = 0; q < kNumbers; ++q)
        CHECK(std::abs(got[2 + q] - want[q]) < kGradientError * size[q]);
      CHECK(got[0] == -7.0f);
      CHECK(got[1] == -7.0f);
      CHECK(got.back() == -7.0f);
    }
  });
}

TEST_CASE("sky: Adam steps use the sum over views, and the colour stays between 0 and 1", "[sky][device]") {
  for_each_stages([](Device& device, Stages& stages) {
    constexpr std::uint32_t kViews = 3;
    Buffer<float> state = uploaded(device, std::vector<float>(kSkyState)),
                  gradient(device, "gradients", kViews * kNumbers);
    Buffer<std::uint32_t> sentinel(device, "sentinel", 1);
    sentinel.zero();
    std::mt19937 random(3);
    std::normal_distribution<float> noise(-0.1f, 1);
    std::array<double, kNumbers> value{}, first{}, second{};
    const auto step = [&](std::uint64_t number, std::uint32_t stamp, bool harmonics) {
      stages.sky_step({.state = state.view(),
                       .gradient = gradient.view(),
                       .views = kViews,
                       .rate = 0.05f,
                       .rate_harmonics = harmonics ? 0.02f : 0.0f,
                       .step = number,
                       .sentinel = sentinel.view(),
                       .stamp = stamp});
    };
    for (std::uint32_t i = 1; i <= 60; ++i) {
      const bool harmonics = i > 10;
      std::vector<float> values(kViews * kNumbers);
      for (float& g : values) g = noise(random);
      gradient.upload(values);
      step(i, i, harmonics);
      for (std::size_t q = 0; q < (harmonics ? kNumbers : 3); ++q) {
        double g = 0;
        for (std::size_t view = 0; view < kViews; ++view) g += values[view * kNumbers + q];
        first[q] = 0.9 * first[q] + 0.1 * g;
        second[q] = 0.999 * second[q] + 0.001 * g * g;
        const double size = std::sqrt(second[q] / (1 - std::pow(0.999, i))) + 1e-4;
        value[q] -= (q < 3 ? 0.05 : 0.02) * first[q] / (1 - std::pow(0.9, i)) / size;
        if (q < 3) value[q] = std::clamp(value[q], 0.0, 1.0);
      }
    }
    const std::vector<float> got = state.download();
    for (std::size_t q = 0; q < kNumbers; ++q) {
      CHECK(std::abs(got[q] - value[q]) < kStepError);
      CHECK(std::abs(got[kNumbers + q] - first[q]) < kStepError);
    }
    // If a gradient is not finite, the coefficients do not change, and later steps are stopped.
    std::vector<float> values(kViews * kNumbers, 0.5f);
    values[4] = std::numeric_limits<float>::quiet_NaN();
    gradient.upload(values);
    step(61, 61, true);
    const std::vector<float> after = state.download();
    CHECK(after[4] == got[4]);
    CHECK(sentinel.download()[0] == 61);
    gradient.upload(std::vector<float>(kViews * kNumbers, 0.5f));
    step(62, 62, true);
    CHECK(state.download() == after);
  });
}

}  // namespace
