// SPDX-License-Identifier: Apache-2.0
#include "cuda_backend/tile_order.hpp"

#include "cuda_backend/grid.hpp"

namespace ubs::cuda {

void TileOrder::make(View1<u32> tile_ranges, unsigned tiles) {
  for (auto [buffer, label] : {std::pair{&keys_, "tile lengths"},
                               {&keys_sorted_, "sorted tile lengths"},
                               {&ids_, "tiles to order"},
                               {&order_, "order of tiles"}})
    reserve(device_, *buffer, label, tiles);
  device_.launch("tile_lengths", kernel_, blocks(tiles, kListBlock), kListBlock, tile_ranges, tiles,
                 keys_.view(), ids_.view());
  device_.algorithm("order_tiles", [&](Workspace& workspace) {
    return sort_pairs(workspace, pointer_of(keys_.view()), pointer_of(keys_sorted_.view()),
                      pointer_of(ids_.view()), pointer_of(order_.view()), tiles, 0, kLengthBits,
                      device_.stream());
  });
  tiles_ = tiles;
}

}  // namespace ubs::cuda
