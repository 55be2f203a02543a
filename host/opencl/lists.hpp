// SPDX-License-Identifier: Apache-2.0
// Tile lists (CountLists and BuildLists of host/device/stages.hpp): drawn splats sorted by depth, then
// distributed over tiles by a stable pass, so that every list is in order of (depth, index).
// RasterKind::cpu: one work-item a chunk, counting pass by tile, CountLists begins the sort. RasterKind::gpu:
// groups with local memory, emission and radix sort by tile. Same results, bit for bit. Only CountLists
// waits, unless the totals are to stay on the device: then buffers and launches are for bounds, and kernels
// read how much there is.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "host/device/stages.hpp"
#include "host/opencl/core_groups.hpp"
#include "host/opencl/kernel_set.hpp"
#include "host/opencl/scan.hpp"

namespace ubs::opencl {

class Lists {
 public:
  Lists(OpenclDevice& device, const KernelConfig& config);

  // Slot offsets wrap when the total is above 2^32 - 1; the total itself is exact.
  ListTotals run(const CountLists& lists);
  // tile_counts given to CountLists must be the areas of tile_rects, all inside the image.
  void run(const BuildLists& lists);

 private:
  using Words = Buffer<std::uint32_t>;
  // A number of elements: `most`, or, bounded, what stands at `counted`, which is no more.
  struct ElementCount {
    std::uint32_t most = 0;
    BufferView<std::uint32_t> counted = {};
  };
  struct Job {
    const BuildLists& lists;
    ElementCount drawn, pairs;  // splats in the lists, intersections
  };
  struct Pairs {  // one side of a sort; the keys and up to two payloads
    BufferView<std::uint32_t> keys, values, values2;
  };

  template <typename T>
  BufferView<T> scratch(Buffer<T>& buffer, std::size_t size);

  void fit(const CountLists& lists, const Blocks& blocks);

  ListTotals count_by_chunks(const CountLists& lists);
  ListTotals add_sums(std::span<const std::byte> chunks);
  BufferView<std::uint32_t> depth_order_by_chunks(const Job& job);
  void place_by_chunks(const Job& job, BufferView<std::uint32_t> order);
  void scan_columns(std::size_t chunks, std::uint32_t bins, BufferView<std::uint32_t> starts);

  ListTotals count_by_groups(const CountLists& lists);
  BufferView<std::uint32_t> depth_order_by_groups(const Job& job);
  void place_by_groups(const Job& job, BufferView<std::uint32_t> order);
  void radix_pass(const Pairs& from, const Pairs& to, const ElementCount& count, std::uint32_t shift);

  OpenclDevice& device_;
  bool chunks_, slots_;
  CoreGroups core_groups_;
  KernelSet kernels_, radix_;
  Scan scan_;
  Buffer<std::uint64_t> sums_, totals_;
  Words drawn_, pairs_;  // (1) each, bounded only
  Words visible_, histogram_, starts_, ids_a_;
  // Chunks only: (key, index) by the first digit of the view counted last, and the range of its keys.
  Buffer<ChunkSums> chunk_sums_;
  Buffer<std::uint64_t> counted_, pairs_a_, pairs_b_;
  std::uint32_t first_bits_ = 0, least_ = 0, largest_ = 0;
  Words visible_keys_, keys_a_, keys_b_, ids_b_;     // groups only
  Words digits_, area_sums_;                         // groups only
  Words tiles_a_, tiles_b_, pair_ids_, pair_slots_;  // groups only, one element an intersection
};

}  // namespace ubs::opencl
