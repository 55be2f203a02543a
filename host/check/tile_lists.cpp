// SPDX-License-Identifier: Apache-2.0
#include "host/check/tile_lists.hpp"

#include <algorithm>
#include <bit>

namespace ubs::check {

void ListedSplats::set_rect(std::size_t i, std::uint32_t x0, std::uint32_t x1, std::uint32_t y0,
                            std::uint32_t y1) {
  rects[2 * i] = x0 | x1 << 16;
  rects[2 * i + 1] = y0 | y1 << 16;
  counts[i] = (x1 - x0 + 1) * (y1 - y0 + 1);
}

TileLists expected_lists(const ListedSplats& splats) {
  TileLists expected;
  for (std::uint32_t i = 0; i < splats.count(); ++i) {
    expected.offsets.push_back(static_cast<std::uint32_t>(expected.totals.intersections));
    expected.totals.intersections += splats.counts[i];
    if (splats.counts[i] > 0) expected.visible.push_back(i);
  }
  expected.totals.visible = expected.visible.size();
  if (expected.totals.intersections > UINT32_MAX) return expected;

  Words order = expected.visible;
  std::stable_sort(order.begin(), order.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return splats.keys[a] < splats.keys[b]; });
  struct Pair {
    std::uint32_t tile, id, slot;
  };
  std::vector<Pair> pairs;
  const auto tiles_x = static_cast<std::uint32_t>(splats.shape.tiles_x());
  for (const std::uint32_t i : order) {
    const std::uint32_t x = splats.rects[2 * std::size_t{i}], y = splats.rects[2 * std::size_t{i} + 1];
    std::uint32_t slot = expected.offsets[i];
    for (std::uint32_t row = y & 0xffff; row <= y >> 16; ++row)
      for (std::uint32_t column = x & 0xffff; column <= x >> 16; ++column)
        pairs.push_back({row * tiles_x + column, i, slot++});
  }
  std::stable_sort(pairs.begin(), pairs.end(), [](const Pair& a, const Pair& b) { return a.tile < b.tile; });
  expected.ranges.assign(static_cast<std::size_t>(splats.shape.tiles()) + 1, 0);
  for (const Pair& pair : pairs) {
    expected.ids.push_back(pair.id);
    expected.slots.push_back(pair.slot);
    ++expected.ranges[pair.tile + 1];
  }
  for (std::size_t t = 1; t < expected.ranges.size(); ++t) expected.ranges[t] += expected.ranges[t - 1];
  return expected;
}

ListedSplats made_up_splats(Random& random, std::uint32_t count, int width, int height, double drawn,
                            std::uint32_t spread) {
  const auto below = [&](std::uint32_t bound) { return static_cast<std::uint32_t>(random.bits() % bound); };
  ListedSplats splats{{width, height},
                      Words(count, 0xffffffffu),
                      Words(2 * std::size_t{count}, 0xdeadbeefu),
                      Words(count, 0)};
  const auto tiles_x = static_cast<std::uint32_t>(splats.shape.tiles_x());
  const auto tiles_y = static_cast<std::uint32_t>(splats.shape.tiles_y());
  for (std::size_t i = 0; i < count; ++i) {
    if (random.uniform(0, 1) >= drawn) continue;
    splats.keys[i] = std::bit_cast<std::uint32_t>(static_cast<float>(random.uniform(0.5, 5.5)));
    const std::uint32_t x0 = below(tiles_x), y0 = below(tiles_y);
    splats.set_rect(i, x0, std::min(tiles_x - 1, x0 + below(spread + 1)), y0,
                    std::min(tiles_y - 1, y0 + below(spread + 1)));
  }
  return splats;
}

}  // namespace ubs::check
