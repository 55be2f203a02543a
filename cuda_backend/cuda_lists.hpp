// SPDX-License-Identifier: Apache-2.0
// Lists builds the tile lists (CountLists and BuildLists of host/device/stages.hpp). It sorts the visible
// splats by depth, writes their intersections in that order, and then sorts these by tile. The sorts are
// stable, so that every list is ordered by (depth, index). CountLists waits for the device, in order to read
// the totals. If the caller lets the totals stay on the device (CountLists::totals), CountLists does not
// wait, and buffers, launches and sorts are sized for upper bounds.
#pragma once

#include "cuda_backend/cuda_device.hpp"
#include "host/device/stages.hpp"

namespace ubs::cuda {

class Lists {
 public:
  explicit Lists(CudaDevice& device) : device_(device), kernels_(list_kernels()) {}

  // Slot offsets wrap if the total number of intersections exceeds 2^32 - 1. The total itself is exact unless
  // it exceeds the largest number that AddCounts can represent.
  ListTotals run(const CountLists& lists);
  // May run only once after each run of CountLists, because it overwrites intermediate results of CountLists.
  void run(const BuildLists& lists);

 private:
  struct ElementCount {
    u32 most;                      // the number of elements, or an upper bound
    BufferView<u32> counted = {};  // the actual number, on the device; only used if `most` is an upper bound
  };
  struct Job {
    const BuildLists& lists;
    ElementCount drawn, pairs;
  };
  void fit(const CountLists& lists);
  void sort_by_depth(u32 splats);  // writes order_
  template <typename Key>
  void place(const Job& job, const TileKernels<Key>& kernels);

  CudaDevice& device_;
  ListKernels kernels_;
  Buffer<u64> before_;  // packed counts (AddCounts)
  Buffer<std::uint64_t> totals_;
  Buffer<u32> drawn_, pairs_;               // one element each; only used with upper bounds
  Buffer<u32> visible_;                     // indices of the splats to sort, in ascending order
  Buffer<u32> keys_, keys_sorted_, order_;  // for the visible splats
  Buffer<u32> tiles_, tiles_sorted_;        // for the intersections; one or two keys per word
  Buffer<u32> pair_ids_;                    // for the intersections
};

}  // namespace ubs::cuda
