// SPDX-License-Identifier: Apache-2.0
// expected_lists() computes tile lists with std::stable_sort. The lists of a device must be bit-identical to
// them. made_up_splats() creates synthetic splats for such lists.
#pragma once

#include <cstdint>
#include <vector>

#include "host/base/random.hpp"
#include "host/device/stages.hpp"

namespace ubs::check {

using Words = std::vector<std::uint32_t>;

// The results of the projection that are needed for the lists.
struct ListedSplats {
  ImageShape shape;
  Words keys, rects, counts;  // as in ProjectForward

  std::uint32_t count() const { return static_cast<std::uint32_t>(keys.size()); }
  // Sets the tiles of a splat: columns x0 .. x1 and rows y0 .. y1, inclusive.
  void set_rect(std::size_t i, std::uint32_t x0, std::uint32_t x1, std::uint32_t y0, std::uint32_t y1);
};

struct TileLists {
  Words visible, offsets, ids, slots,
      ranges;  // `ids`, `slots` and `ranges` are empty if there are more than 2^32 - 1 intersections.
  ListTotals totals;
};

TileLists expected_lists(const ListedSplats& splats);

// Creates splats. A share of about `drawn` is visible and covers 1 to 1 + spread tiles in each direction. The
// data of the others are meaningless.
ListedSplats made_up_splats(Random& random, std::uint32_t count, int width, int height, double drawn,
                            std::uint32_t spread);

}  // namespace ubs::check
