// SPDX-License-Identifier: Apache-2.0
// Compares the sums over the gradient slots of each splat with sums in float64. The splats have no, few or
// many slots, and the ones with many slots have different positions in a work-group. Slots with mask 0
// contain NaN, because they must not be added.
#include <cmath>
#include <limits>
#include <random>

#include "host/device/stage_sizes.hpp"
#include "kernels/layout.h"
#include "tests/support/stages_fixture.hpp"

namespace ubs {
namespace {

constexpr std::size_t kStride = kGradStride, kSlotStride = stage_sizes::slot_floats(RasterKind::gpu);

struct Slots {
  std::vector<std::uint32_t> counts, offsets;
  std::vector<std::uint16_t> masks;
  std::vector<float> values;
  std::vector<double> sums, magnitudes;  // for each value of a splat, the sum and the sum of absolute values
};

Slots random_slots(const std::vector<std::uint32_t>& counts) {
  std::mt19937 random{7};
  std::uniform_real_distribution<float> value(-1, 1);
  Slots s{.counts = counts};
  for (const std::uint32_t count : counts) {
    s.offsets.push_back(static_cast<std::uint32_t>(s.masks.size()));
    std::vector<double> sum(kStride), magnitude(kStride);
    for (std::uint32_t slot = 0; slot < count; ++slot) {
      s.masks.push_back(random() % 4 == 0 ? 0 : static_cast<std::uint16_t>(1 + random() % 65535));
      for (std::size_t k = 0; k < kSlotStride; ++k) {
        const float x = s.masks.back() != 0 ? value(random) : std::numeric_limits<float>::quiet_NaN();
        s.values.push_back(x);
        if (s.masks.back() == 0) continue;
        sum[k] += static_cast<double>(x);
        magnitude[k] += std::abs(static_cast<double>(x));
      }
    }
    s.sums.insert(s.sums.end(), sum.begin(), sum.end());
    s.magnitudes.insert(s.magnitudes.end(), magnitude.begin(), magnitude.end());
  }
  return s;
}

using test::uploaded;

std::vector<float> sums_of(Device& device, Stages& stages, const Slots& s) {
  const auto counts = uploaded(device, s.counts), offsets = uploaded(device, s.offsets);
  const auto masks = uploaded(device, s.masks);
  const auto values = uploaded(device, s.values);
  const std::size_t splats = s.counts.size();
  const Buffer<float> records(device, "test", splats * kSplatStride), sums(device, "test", splats * kStride);
  SlotViews slots;
  slots.pieces[0] = values.view();
  slots.count = 1;
  stages.sum_slots({.count = static_cast<std::uint32_t>(splats),
                    .tile_counts = counts.view(),
                    .slot_offsets = offsets.view(),
                    .slots = slots,
                    .masks = masks.view(),
                    .records = records.view(),
                    .v_records = sums.view()});
  return sums.download();
}

TEST_CASE("sums over the slots of splats agree with float64 and are reproducible", "[sum_slots]") {
  std::vector<std::vector<std::uint32_t>> cases{
      {0}, {1}, {64}, {65}, {2500}, {3, 0, 64, 65, 63, 1, 79, 80, 81}, std::vector<std::uint32_t>(100, 66)};
  // Splats with many slots that are the first or the last of a work-group, or between other splats of a warp.
  for (const std::uint32_t wide : {0u, 1u, 15u, 16u, 17u, 31u, 40u}) {
    std::vector<std::uint32_t> counts(41, 2);
    counts[wide] = 1000;
    cases.push_back(counts);
  }
  test::for_each_stages([&](Device& device, Stages& stages) {
    // The slots of the CPU rasteriser contain sums from which gradients are computed, so they are not
    // compared here.
    if (stages.config().raster == RasterKind::cpu) return;
    for (const std::vector<std::uint32_t>& counts : cases) {
      const Slots slots = random_slots(counts);
      const std::vector<float> found = sums_of(device, stages, slots);
      REQUIRE(found.size() == slots.sums.size());
      double most = 0;
      for (std::size_t i = 0; i < found.size(); ++i) {
        const double error = std::abs(static_cast<double>(found[i]) - slots.sums[i]);
        if (!(error <= most * std::max(slots.magnitudes[i], 1e-30)))
          most = error / std::max(slots.magnitudes[i], 1e-30);
      }
      // The error is relative to the sum of absolute values. The largest error observed is 1.2e-7.
      CHECK(most < 2.4e-7);
      CHECK(found == sums_of(device, stages, slots));
    }
  });
}

}  // namespace
}  // namespace ubs
