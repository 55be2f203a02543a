// SPDX-License-Identifier: Apache-2.0
// Tests that ground-truth images are transferred correctly to the device. Some images stay on the device, and
// others are uploaded to staging buffers, either ahead of time or when they are needed. This must also work
// while earlier commands that read the same staging buffer are still in the queue.
#include "host/train/target_images.hpp"

#include <catch2/catch.hpp>

#include "tests/support/device_fixture.hpp"

namespace ubs {
namespace {

constexpr int kWidth = 301, kHeight = 203;
constexpr std::size_t kViews = 5, kBytes = 3ull * kWidth * kHeight;

std::uint8_t value(std::size_t view, std::size_t plane, std::size_t pixel) {
  return static_cast<std::uint8_t>(31 * view + 7 * plane + pixel % 251);
}

Split images() {
  Split split;
  for (std::size_t v = 0; v < kViews; ++v) {
    View view;
    view.name = "view " + std::to_string(v);
    view.image = {.width = kWidth, .height = kHeight, .rgb = std::vector<std::uint8_t>(kBytes)};
    for (std::size_t i = 0; i < kBytes; ++i) view.image.rgb[i] = value(v, i % 3, i / 3);
    split.views.push_back(std::move(view));
  }
  return split;
}

TEST_CASE("target images are uploaded without changes", "[training]") {
  const Split split = images();
  for (const auto& device : devices_under_test())
    for (const std::size_t resident : {0, 2, 9})  // number of images for which the device has memory
      for (const bool ahead : {false, true}) {
        DYNAMIC_SECTION(device->info().name << ", room for " << resident << ", ahead " << ahead) {
          TargetImages targets(*device, resident * kBytes);
          targets.add(split);
          const std::size_t order[] = {0, 3, 1, 1, 4, 2, 0, 4, 3, 2, 2, 1};
          Buffer<std::uint8_t> readers(*device, "readers", std::size(order) * kBytes);
          for (std::size_t k = 0; k < std::size(order); ++k) {
            const Target target = targets.get(order[k]);
            CHECK(target.mask.size == 0);
            device->copy(*target.image.memory, 0, *readers.view().memory, k * kBytes, kBytes);
            if (ahead && k + 1 < std::size(order)) targets.upload(order[k + 1]);
          }
          const std::vector<std::uint8_t> seen = readers.download();
          std::size_t wrong = 0;
          for (std::size_t k = 0; k < std::size(order); ++k)
            for (std::size_t i = 0; i < kBytes; ++i)
              wrong += seen[k * kBytes + i] != value(order[k], i / (kBytes / 3), i % (kBytes / 3));
          CHECK(wrong == 0);
        }
      }
}

}  // namespace
}  // namespace ubs
