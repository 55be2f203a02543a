// SPDX-License-Identifier: Apache-2.0
// Tile lists by std::stable_sort, which those of a device equal bit for bit; and made-up splats to list.
#pragma once

#include <cstdint>
#include <vector>

#include "host/base/random.hpp"
#include "host/device/stages.hpp"

namespace ubs::check {

using Words = std::vector<std::uint32_t>;

// What projection leaves of each splat for the lists.
struct ListedSplats {
  ImageShape shape;
  Words keys, rects, counts;  // as of ProjectForward

  std::uint32_t count() const { return static_cast<std::uint32_t>(keys.size()); }
  // Columns x0 .. x1 and rows y0 .. y1 of tiles.
  void set_rect(std::size_t i, std::uint32_t x0, std::uint32_t x1, std::uint32_t y0, std::uint32_t y1);
};

struct TileLists {
  Words visible, offsets, ids, slots,
      ranges;  // ids, slots and ranges are empty beyond 2^32 - 1 intersections
  ListTotals totals;
};

TileLists expected_lists(const ListedSplats& splats);

// About `drawn` of the splats, each with sides of 1 .. 1 + spread tiles; what stands for the others is
// nonsense.
ListedSplats made_up_splats(Random& random, std::uint32_t count, int width, int height, double drawn,
                            std::uint32_t spread);

}  // namespace ubs::check
