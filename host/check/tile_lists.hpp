// SPDX-License-Identifier: Apache-2.0
// expected_lists() computes tile lists with std::stable_sort. The lists of a device must be bit-identical to
// these lists. made_up_splats() creates synthetic splats for them.
#pragma once

#include <cstdint>
#include <vector>

#include "host/base/random.hpp"
#include "host/device/stages.hpp"

namespace ubs::check {

using Words = std::vector<std::uint32_t>;

// ListedSplats holds the results of the projection that lists are built from.
struct ListedSplats {
  ImageShape shape;
  Words keys, rects, counts;  // depth_keys, tile_rects and tile_counts of ProjectForward

  std::uint32_t count() const { return static_cast<std::uint32_t>(keys.size()); }
  // Sets the tiles of splat i to the columns x0 to x1 and the rows y0 to y1, inclusive.
  void set_rect(std::size_t i, std::uint32_t x0, std::uint32_t x1, std::uint32_t y0, std::uint32_t y1);
};

struct TileLists {
  // `ids`, `slots` and `ranges` are empty if there are more than 2^32 - 1 intersections.
  Words visible, offsets, ids, slots, ranges;
  ListTotals totals;
};

TileLists expected_lists(const ListedSplats& splats);

// Creates `count` splats. The share `drawn` of them is visible, and each of these covers 1 to 1 + `spread`
// tiles in each direction. The keys and rects of invisible splats are arbitrary numbers, because kernels must
// not use them.
ListedSplats made_up_splats(Random& random, std::uint32_t count, int width, int height, double drawn,
                            std::uint32_t spread);

}  // namespace ubs::check
