// SPDX-License-Identifier: Apache-2.0
// Tile lists (CountLists and BuildLists of host/device/stages.hpp): drawn splats sorted by depth, then
// distributed over tiles by a stable pass, so that every list is in order of (depth, index).
// RasterKind::cpu: one work-item a chunk, counting pass by tile. RasterKind::gpu: groups with local memory,
// emission and radix sort by tile. Same results, bit for bit. Only count() waits.
#pragma once

#include <cstdint>

#include "host/device/stages.hpp"
#include "host/opencl/kernel_set.hpp"
#include "host/opencl/scan.hpp"

namespace ubs::opencl {

class Lists {
 public:
  Lists(OpenclDevice& device, const KernelConfig& config);

  // Slot offsets wrap when the total is above 2^32 - 1; the total itself is exact.
  ListTotals count(const CountLists& lists);
  // tile_counts given to count() must be the areas of tile_rects, all inside the image.
  void build(const BuildLists& lists);

 private:
  using Words = Buffer<std::uint32_t>;
  struct Pairs {  // one side of a sort; the keys and up to two payloads
    View1<std::uint32_t> keys, values, values2;
  };

  Blocks blocks(std::uint64_t elements) const;
  Words& scratch(Words& buffer, std::size_t size);

  View1<std::uint32_t> depth_order_by_chunks(const BuildLists& lists, std::uint32_t drawn);
  void place_by_chunks(const BuildLists& lists, std::uint32_t drawn, View1<std::uint32_t> order);
  void scan_columns(std::size_t chunks, std::uint32_t bins, View1<std::uint32_t> starts);

  View1<std::uint32_t> depth_order_by_groups(const BuildLists& lists, std::uint32_t drawn);
  void place_by_groups(const BuildLists& lists, std::uint32_t drawn, View1<std::uint32_t> order);
  void radix_pass(const Pairs& from, const Pairs& to, std::uint32_t count, std::uint32_t shift);

  OpenclDevice& device_;
  bool chunks_, view_cull_, slots_;
  KernelSet kernels_, radix_;
  Scan scan_;
  Buffer<std::uint64_t> sums_, totals_;
  Words keys_a_, keys_b_, ids_a_, ids_b_, histogram_, starts_;
  Words tiles_a_, tiles_b_, pair_ids_, pair_slots_;  // groups only, one element an intersection
};

}  // namespace ubs::opencl
