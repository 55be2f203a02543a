// SPDX-License-Identifier: Apache-2.0
// Tests the stages PlaceDrawn, PickDrawn, UnpackDrawn and SpreadGradient on every device. They must copy the
// records of the visible splats in order and without changing a bit, restore the values that the lists of
// tiles need, and write gradients back to the right splats.
#include <bit>
#include <random>

#include "kernels/layout.h"
#include "tests/support/stages_fixture.hpp"

namespace ubs {
namespace {

constexpr std::size_t kStride = kSplatStride;
// Index of the first of two values of a record that are not used otherwise, so PickDrawn stores the rectangle
// of tiles there.
constexpr std::size_t kSpare = kSplatReach + 1;

using test::uploaded;

struct Splats {
  std::vector<float> records, gradients;
  std::vector<std::uint32_t> rects, tiles;
  std::vector<std::size_t> drawn;
};

// Returns splats whose records and gradients contain random bits, but no NaN. About one of `every` splats is
// visible, or none if `every` is 0.
Splats splats(std::uint32_t count, unsigned every) {
  std::mt19937 random(count + every);
  Splats s;
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t k = 0; k < kStride; ++k) {
      const auto word = static_cast<std::uint32_t>(random() & 0xbfffffffu);
      s.records.push_back(std::bit_cast<float>(word));
      s.gradients.push_back(std::bit_cast<float>(word ^ 0x123u));
    }
    const auto below = [&](unsigned n) { return static_cast<std::uint32_t>(random() % n); };
    const std::uint32_t x0 = below(9), x1 = x0 + below(5), y0 = below(7), y1 = y0 + below(3);
    s.rects.push_back(x0 | x1 << 16);
    s.rects.push_back(y0 | y1 << 16);
    const bool drawn = every > 0 && random() % every == 0;
    s.tiles.push_back(drawn ? (x1 - x0 + 1) * (y1 - y0 + 1) : 0);
    if (drawn) s.drawn.push_back(i);
  }
  return s;
}

TEST_CASE("records of visible splats are packed and unpacked, and gradients are written back") {
  test::for_each_stages([](Device& device, Stages& stages) {
    for (const auto& [count, every] : {std::pair{0u, 1u}, {1u, 1u}, {64u, 0u}, {777u, 3u}, {70000u, 2u}}) {
      INFO(count << " splats, one of " << every << " visible");
      const Splats s = splats(count, every);
      const Buffer<float> records = uploaded(device, s.records), gradients = uploaded(device, s.gradients);
      const Buffer<std::uint32_t> rects = uploaded(device, s.rects), tiles = uploaded(device, s.tiles);
      const Buffer<std::uint32_t> places(device, "places", count + std::size_t{1});
      const std::uint32_t drawn =
          stages.place_drawn({.count = count, .tile_counts = tiles.view(), .places = places.view()});
      REQUIRE(drawn == s.drawn.size());
      const std::size_t size = std::max<std::size_t>(drawn, 1);
      const Buffer<float> rows(device, "rows", kStride * size);
      stages.pick_drawn({.count = count,
                         .records = records.view(),
                         .tile_rects = rects.view(),
                         .places = places.view(),
                         .drawn = rows.view()});
      const Buffer<std::uint32_t> keys(device, "keys", size), rects_of(device, "rects", 2 * size),
          tiles_of(device, "tiles", size);
      stages.unpack_drawn({.count = drawn,
                           .records = rows.view(),
                           .depth_keys = keys.view(),
                           .tile_rects = rects_of.view(),
                           .tile_counts = tiles_of.view()});
      const auto row = rows.download();
      const auto key = keys.download(), rect = rects_of.download(), tile = tiles_of.download();
      std::size_t wrong = 0;
      for (std::size_t j = 0; j < drawn; ++j) {
        const std::size_t i = s.drawn[j];
        for (std::size_t k = 0; k < kStride; ++k) {
          const float expected = k == kSpare || k == kSpare + 1 ? 0.0f : s.records[kStride * i + k];
          wrong +=
              std::bit_cast<std::uint32_t>(row[kStride * j + k]) != std::bit_cast<std::uint32_t>(expected);
        }
        wrong += key[j] != std::bit_cast<std::uint32_t>(s.records[kStride * i + kSplatDepth]);
        wrong += rect[2 * j] != s.rects[2 * i] || rect[2 * j + 1] != s.rects[2 * i + 1];
        wrong += tile[j] != s.tiles[i];
      }
      CHECK(wrong == 0);
      // The first `drawn` rows of s.gradients are the gradients of the visible splats.
      const Buffer<float> spread(device, "spread", kStride * std::max<std::size_t>(count, 1));
      stages.spread_gradient(
          {.count = count, .drawn = gradients.view(), .places = places.view(), .v_records = spread.view()});
      std::vector<float> expected(kStride * count);
      for (std::size_t j = 0; j < drawn; ++j)
        std::copy_n(s.gradients.begin() + static_cast<std::ptrdiff_t>(kStride * j), kStride,
                    expected.begin() + static_cast<std::ptrdiff_t>(kStride * s.drawn[j]));
      std::vector<float> values(kStride * count);
      if (count > 0) spread.download(std::span<float>(values));
      CHECK((values == expected));
    }
  });
}

}  // namespace
}  // namespace ubs
