// SPDX-License-Identifier: Apache-2.0
// Tests the stages AlphaToColours, DepthToRecords, DepthToImage and DepthFromRecords on every device.
// Compares their results with those of loops that compute in double.
#include <cmath>
#include <random>

#include "kernels/layout.h"
#include "tests/support/stages_fixture.hpp"

namespace ubs {
namespace {

using test::uploaded;

// Returns numbers between 0.1 and 1 with random signs. About one of three numbers is 0 if `zeros` is true.
std::vector<float> numbers(std::size_t count, unsigned seed, bool zeros = false) {
  std::mt19937 random(seed);
  std::vector<float> values(count);
  for (float& v : values) {
    v = 0.1f + 0.9f * static_cast<float>(random() % 1000) / 1000;
    if (random() % 2) v = -v;
    if (zeros && random() % 3 == 0) v = 0;
  }
  return values;
}

bool inside(const ImageShape& s, std::size_t at) {
  const std::size_t pitch = static_cast<std::size_t>(s.pitch());
  return at % pitch < static_cast<std::size_t>(s.width) && at / pitch < static_cast<std::size_t>(s.height);
}

TEST_CASE("the gradient of alpha is added to one channel of each pixel") {
  test::for_each_stages([](Device& device, Stages& stages) {
    for (const ImageShape shape : {ImageShape{1, 1}, {16, 16}, {17, 3}, {61, 45}, {300, 1}}) {
      const std::size_t plane = shape.plane();
      std::vector<float> v_alpha = numbers(plane, 1, true);
      v_alpha[0] = 0.5f;  // at least one pixel has a gradient
      const std::vector<float> left = numbers(plane, 2);
      const std::vector<float> image = numbers(3 * plane, 3);
      std::vector<float> v_image = numbers(3 * plane, 4);
      for (std::size_t at = 0; at < plane; at += 5)  // pixels whose colours have no gradient
        for (std::size_t c = 0; c < 3; ++c) v_image[c * plane + at] = 0;
      const Buffer<float> of_image = uploaded(device, image), of_v_image = uploaded(device, v_image);
      const Buffer<float> of_alpha = uploaded(device, v_alpha), of_left = uploaded(device, left);
      stages.alpha_to_colours({.shape = shape,
                               .v_alpha = of_alpha.view(),
                               .transmittance = of_left.view(),
                               .image = of_image.view(),
                               .v_image = of_v_image.view()});
      const std::vector<float> found = of_image.download(), v_found = of_v_image.download();
      std::size_t wrong = 0, changed = 0;
      double worst = 0;
      for (std::size_t at = 0; at < plane; ++at) {
        // The change of the remainder behind the last splat, and the change of the gradient of the colours.
        double remainder = 0, largest = 0;
        for (std::size_t c = 0; c < 3; ++c) {
          const std::size_t k = c * plane + at;
          remainder += (static_cast<double>(found[k]) - image[k]) * v_found[k];
          largest = std::max(largest, std::abs(static_cast<double>(v_found[k]) - v_image[k]));
        }
        const double expected = inside(shape, at) ? -static_cast<double>(v_alpha[at]) * left[at] : 0.0;
        worst = std::max(worst, std::abs(remainder - expected));
        if (!(largest <= 1e-9)) ++wrong;
        if (expected != 0) ++changed;
      }
      INFO(shape.width << "x" << shape.height);
      CHECK(worst <= 2.2e-7);  // the largest error on PoCL is 1.1e-7
      CHECK(wrong == 0);
      CHECK(changed > 0);
    }
  });
}

TEST_CASE("depth becomes a colour of splats and images, and its gradient that of the depth of splats") {
  test::for_each_stages([](Device& device, Stages& stages) {
    for (const ImageShape shape : {ImageShape{1, 1}, {16, 16}, {17, 3}, {61, 45}, {300, 1}})
      for (const std::uint32_t count : {0u, 1u, 63u, 64u, 65u, 300u}) {
        INFO(shape.width << "x" << shape.height << ", " << count << " splats");
        const std::size_t plane = shape.plane();
        std::vector<float> depth = numbers(plane, 5, true), v_depth = numbers(plane, 6, true);
        v_depth[0] = 1, depth[0] = 0.5f;  // there is at least one pixel with a gradient
        const std::vector<float> records = numbers(kSplatStride * count, 7);
        double sum = 0, pixels = 0;
        for (std::size_t at = 0; at < plane; ++at)
          if (inside(shape, at) && depth[at] != 0 && v_depth[at] != 0) sum += depth[at], pixels += 1;
        const double mean = sum / pixels;
        const Buffer<float> of_depth = uploaded(device, depth), of_v_depth = uploaded(device, v_depth);
        const Buffer<float> of_records = uploaded(device, records), of_mean(device, "mean", 1);
        stages.depth_to_records({.shape = shape,
                                 .depth = of_depth.view(),
                                 .v_depth = of_v_depth.view(),
                                 .count = count,
                                 .mean = of_mean.view(),
                                 .records = of_records.view()});
        double worst = std::abs(of_mean.download()[0] - mean);
        const std::vector<float> as_colours = of_records.download();
        for (std::size_t k = 0; k < records.size(); ++k) {
          const std::size_t field = k % kSplatStride;
          const double z = records[k - field + kSplatDepth];
          const double expected = field == kSplatR   ? z - mean
                                  : field == kSplatG ? 1.0
                                  : field == kSplatB ? 0.0
                                                     : records[k];
          worst = std::max(worst, std::abs(as_colours[k] - expected));
        }

        std::vector<float> image = numbers(3 * plane, 8);
        const Buffer<float> of_image = uploaded(device, image), of_v_image = uploaded(device, image);
        stages.depth_to_image({.shape = shape,
                               .depth = of_depth.view(),
                               .v_depth = of_v_depth.view(),
                               .mean = of_mean.view(),
                               .image = of_image.view(),
                               .v_image = of_v_image.view()});
        const std::vector<float> values = of_image.download(), v_values = of_v_image.download();
        for (std::size_t at = 0; at < plane; ++at) {
          const float weight = image[plane + at];
          const bool seen = inside(shape, at) && weight > 1e-6f;
          worst = std::max(worst, std::abs(values[at] - (seen ? depth[at] - mean : 0.0)));
          const double v = seen ? static_cast<double>(v_depth[at]) / weight : 0.0;
          worst = std::max(worst, std::abs(v_values[at] - v) / (1 + std::abs(v)));
          for (std::size_t c = 1; c < 3; ++c)
            worst = std::max(worst, static_cast<double>(std::abs(v_values[c * plane + at])));
        }

        const std::vector<float> v_records = numbers(kGradStride * count, 9);
        const std::vector<float> earlier = numbers(kGradStride * count, 10);
        const Buffer<float> of_earlier = uploaded(device, earlier);
        for (const bool adds : {false, true}) {
          const Buffer<float> of_v = uploaded(device, v_records);
          stages.depth_from_records({.count = count,
                                     .earlier = adds ? of_earlier.view() : BufferView<float>{},
                                     .v_records = of_v.view()});
          const std::vector<float> found = of_v.download();
          for (std::size_t k = 0; k < v_records.size(); ++k) {
            const std::size_t field = k % kGradStride;
            double expected = field == kGradR || field == kGradG || field == kGradB ? 0.0 : v_records[k];
            if (field == kGradDepth) expected = v_records[k - kGradDepth + kGradR];
            if (adds && field < kGradDepth) expected += earlier[k];
            worst = std::max(worst, std::abs(found[k] - expected));
          }
        }
        CHECK(worst <= 1.2e-7);  // the largest error on PoCL is 6.0e-8
      }
  });
}

}  // namespace
}  // namespace ubs
