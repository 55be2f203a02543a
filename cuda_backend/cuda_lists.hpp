// SPDX-License-Identifier: Apache-2.0
// Tile lists (CountLists and BuildLists of host/device/stages.hpp): drawn splats sorted by depth, emitted in
// that order, then sorted stably by tile, so that every list is in order of (depth, index). Only CountLists
// waits, unless the totals are to stay on the device: then buffers, launches and sorts are for bounds.
#pragma once

#include "cuda_backend/cuda_device.hpp"
#include "host/device/stages.hpp"

namespace ubs::cuda {

class Lists {
 public:
  explicit Lists(CudaDevice& device) : device_(device), kernels_(list_kernels()) {}

  // Slot offsets wrap when the total is above 2^32 - 1; the total itself is exact as far as AddCounts is.
  ListTotals run(const CountLists& lists);
  void run(const BuildLists& lists);  // once: what CountLists left is used up

 private:
  struct ElementCount {
    u32 most;
    BufferView<u32> counted = {};  // (1), bounded only
  };
  struct Job {
    const BuildLists& lists;
    ElementCount drawn, pairs;
  };
  void fit(const CountLists& lists);
  void sort_by_depth(u32 splats);  // -> order_
  void place(const Job& job);

  CudaDevice& device_;
  ListKernels kernels_;
  Buffer<u64> before_;  // AddCounts
  Buffer<std::uint64_t> totals_;
  Buffer<u32> drawn_, pairs_;                    // (1) each, bounded only
  Buffer<u32> visible_;                          // indices of what is sorted, ascending; keys_ are theirs
  Buffer<u32> keys_, keys_sorted_, order_;       // drawn splats
  Buffer<u32> tiles_, tiles_sorted_, pair_ids_;  // intersections
};

}  // namespace ubs::cuda
