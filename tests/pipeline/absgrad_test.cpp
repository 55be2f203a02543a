// SPDX-License-Identifier: Apache-2.0
// Compares the sums of absolute gradients of positions (KernelConfig::absgrad) with the gradients of single
// pixels.
#include <fmt/format.h>

#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "host/lab/bench/bench_scene.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/image_gradient.hpp"
#include "host/pipeline/renderer.hpp"
#include "tests/pipeline/oracle_comparison.hpp"
#include "tests/support/compare.hpp"
#include "tests/support/device_fixture.hpp"

namespace ubs {
namespace {

class Gradients {
 public:
  Gradients(Device& device, const KernelConfig& config, const bench::BenchScene& scene)
      : device_(device),
        stages_(make_stages(device, config)),
        model_(device, scene.model),
        renderer_(device, *stages_) {
    renderer_.set_cameras({scene.views.views[0].camera});
  }
  // Returns the gradients of the projected splats, an array of shape (splats, kGradStride), for the gradient
  // `v_image` of the image, an array of shape (3, height, width).
  std::vector<float> of(std::span<const float> v_image) {
    renderer_.forward(model_.view(), 0, {}, true);
    const std::vector<float> padded = padded_planes(v_image, renderer_.shape());
    device_.write(*renderer_.v_image().memory, 0, std::as_bytes(std::span(padded)));
    renderer_.backward_to_records();
    return read_values(device_, renderer_.v_records(), renderer_.v_records().size);
  }

  // Does the same for an image with further channels, which have the values of red, green, blue, red, ...
  // They have the gradients `v_more`, an array of shape (height, width, channels).
  std::vector<float> of(std::span<const float> v_rgb, std::span<const float> v_more, std::uint32_t channels) {
    renderer_.forward(model_.view(), 0, {}, true);
    const std::vector<float> rgb = renderer_.download().rgb;
    const std::vector<float> records = read_values(device_, renderer_.records(), renderer_.records().size);
    std::vector<float> image, colours;
    for (std::size_t pixel = 0; pixel < rgb.size() / 3; ++pixel)
      for (std::size_t c = 0; c < channels; ++c) image.push_back(rgb[3 * pixel + c % 3]);
    for (std::size_t splat = 0; splat < records.size() / kSplatStride; ++splat)
      for (std::size_t c = 0; c < channels; ++c)
        colours.push_back(records[splat * kSplatStride + kSplatR + c % 3]);
    ImageBackward backward(device_, *stages_, renderer_);
    backward.run({.rgb = v_rgb,
                  .more_channels = channels,
                  .more = v_more,
                  .more_image = image,
                  .more_colours = colours},
                 {});
    return read_values(device_, renderer_.v_records(), renderer_.v_records().size);
  }

 private:
  Device& device_;
  std::unique_ptr<Stages> stages_;
  DeviceModel model_;
  Renderer renderer_;
};

TEST_CASE("absolute gradients of positions are sums of the absolute gradients of single pixels",
          "[renderer]") {
  constexpr int kWidth = 24, kHeight = 20;
  constexpr std::size_t kPixels = std::size_t{kWidth} * kHeight;
  const bench::BenchScene scene = bench::random_start(3, 60, kWidth, kHeight);
  std::mt19937 random(1);
  std::normal_distribution<float> normal;
  std::vector<float> v_image(3 * kPixels);
  for (float& v : v_image) v = normal(random);
  for (const auto& device : devices_under_test())
    for (const RasterKind raster : rasters_of(*device)) {
      INFO(device->info().name << ", raster " << test::text(raster));
      KernelConfig config{.dim = 3, .raster = raster};
      Gradients plain(*device, config, scene);
      config.absgrad = true;
      Gradients absolute(*device, config, scene);
      std::vector<double> expected(2 * scene.model.count);
      for (std::size_t pixel = 0; pixel < kPixels; ++pixel) {
        std::vector<float> one(3 * kPixels);
        for (std::size_t c = 0; c < 3; ++c) one[c * kPixels + pixel] = v_image[c * kPixels + pixel];
        const std::vector<float> v = plain.of(one);
        for (std::size_t i = 0; i < scene.model.count; ++i)
          for (std::size_t k = 0; k < 2; ++k)
            expected[2 * i + k] += std::abs(static_cast<double>(v[i * kGradStride + kGradX + k]));
      }
      const std::vector<float> all = plain.of(v_image), found = absolute.of(v_image);
      std::vector<float> sums, others;
      std::vector<double> plain_others;
      for (std::size_t i = 0; i < scene.model.count; ++i) {
        const std::size_t at = i * kGradStride;
        for (std::size_t k = 0; k < 2; ++k) sums.push_back(found[at + kGradX + k]);
        for (std::size_t k = kGradW00; k <= kGradB; ++k) {
          others.push_back(found[at + k]);
          plain_others.push_back(static_cast<double>(all[at + k]));
        }
      }
      const double error = test::relative_error(sums, expected);
      fmt::print("raster {}: absolute gradients {:.1e}\n", test::text(raster), error);
      CHECK(error < 1.1e-7);  // the largest error observed is 5.4e-8
      CHECK(test::relative_error(others, plain_others) < 1e-7);
    }
}

// The further channels repeat red, green and blue, so the gradients must be those of an image with three
// channels and the sums of all gradients. With 3000 splats, lists have several segments (kListSegment).
TEST_CASE("further channels are part of absolute gradients", "[renderer]") {
  constexpr int kWidth = 24, kHeight = 20;
  constexpr std::size_t kPixels = std::size_t{kWidth} * kHeight;
  for (const std::size_t splats : {60u, 3000u}) {
    bench::BenchScene scene = bench::random_start(3, splats, kWidth, kHeight);
    // The splats are so transparent that blending does not stop before the end of a list.
    for (float& logit : scene.model.row(scene.model.layout().opacity)) logit -= splats > 60 ? 3 : 0;
    std::mt19937 random(2);
    std::normal_distribution<float> normal;
    for (const std::uint32_t channels : {1u, 5u}) {
      std::vector<float> v_rgb(3 * kPixels), v_more(channels * kPixels), planes(3 * kPixels);
      for (float& v : v_rgb) v = normal(random);
      for (float& v : v_more) v = normal(random);
      for (std::size_t pixel = 0; pixel < kPixels; ++pixel) {
        for (std::size_t c = 0; c < 3; ++c) planes[c * kPixels + pixel] = v_rgb[3 * pixel + c];
        for (std::size_t c = 0; c < channels; ++c)
          planes[c % 3 * kPixels + pixel] += v_more[channels * pixel + c];
      }
      for (const auto& device : devices_under_test())
        for (const RasterKind raster : rasters_of(*device)) {
          Gradients gradients(*device, {.dim = 3, .raster = raster, .absgrad = true}, scene);
          const std::vector<float> of_three = gradients.of(planes);
          const std::vector<float> found = gradients.of(v_rgb, v_more, channels);
          std::vector<float> of_shape;
          std::vector<double> expected;
          for (std::size_t i = 0; i < scene.model.count; ++i)
            for (std::size_t k = 0; k < kGradR; ++k) {
              of_shape.push_back(found[i * kGradStride + k]);
              expected.push_back(static_cast<double>(of_three[i * kGradStride + k]));
            }
          const double error = test::relative_error(of_shape, expected);
          fmt::print("{}, raster {}, {} splats, {} further channels: {:.1e}\n", device->info().name,
                     test::text(raster), splats, channels, error);
          CHECK(error < 3.8e-7);  // the largest error observed is 1.9e-7
        }
    }
  }
}

}  // namespace
}  // namespace ubs
