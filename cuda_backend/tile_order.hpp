// SPDX-License-Identifier: Apache-2.0
// The order in which the rasterisers begin tiles, longest lists first, so that no long one is left for the
// end.
#pragma once

#include "cuda_backend/cuda_device.hpp"

namespace ubs::cuda {

class TileOrder {
 public:
  explicit TileOrder(CudaDevice& device) : device_(device), kernel_(length_keys()) {}

  // By lengths in steps of an eighth of their power of two, tiles of the same step in their own order. Two
  // launches.
  void make(View1<u32> tile_ranges, unsigned tiles);
  // Of any lists with so many tiles: it decides when a tile is drawn, not what.
  bool fits(unsigned tiles) const { return tiles == tiles_; }
  View1<u32> view() const { return order_.view(); }

 private:
  CudaDevice& device_;
  LengthKeys kernel_;
  unsigned tiles_ = 0;
  Buffer<u32> keys_, keys_sorted_, ids_, order_;
};

}  // namespace ubs::cuda
