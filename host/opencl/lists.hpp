// SPDX-License-Identifier: Apache-2.0
// Lists builds the tile lists (CountLists and BuildLists of host/device/stages.hpp). It sorts the visible
// splats by depth, then distributes them over the tiles with a stable pass, so that every list is ordered by
// (depth, index).
// With RasterKind::cpu, one work-item processes a chunk of elements, and a counting sort sorts by tile. With
// RasterKind::gpu, work-groups with local memory write the intersections, and a radix sort sorts them by
// tile. Both give bit-identical results. In both cases, CountLists already starts the depth sort. CountLists
// waits for the device, unless the totals stay on the device; BuildLists never waits. If the totals stay on
// the device, buffers and launches are sized for upper bounds, and the kernels read the actual numbers.
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

  // Slot offsets overflow if the number of intersections exceeds 2^32 - 1. The returned number itself is
  // exact.
  ListTotals run(const CountLists& lists);
  // The tile_counts that were passed to CountLists must be the areas of tile_rects, which must all be inside
  // the image.
  void run(const BuildLists& lists);

 private:
  using Words = Buffer<std::uint32_t>;
  // ElementCount is a number of elements. If `counted` is empty, the number is `most`. Otherwise the number
  // is the value in the buffer `counted`, and `most` is an upper bound.
  struct ElementCount {
    std::uint32_t most = 0;
    BufferView<std::uint32_t> counted = {};
  };
  struct Job {
    const BuildLists& lists;
    ElementCount drawn, pairs;  // visible splats, intersections
  };
  template <typename Key>
  struct Pairs {  // input or output of a sort: the keys and up to two payloads
    BufferView<Key> keys;
    BufferView<std::uint32_t> values, values2;
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
  // `kernels` and `radix` contain the kernels for tile keys of the type Key.
  template <typename Key>
  void place_by_groups(const Job& job, BufferView<std::uint32_t> order, KernelSet& kernels, KernelSet& radix);
  BufferView<std::uint32_t> scratch_histogram(const Blocks& blocks);
  // Runs one pass of a radix sort. `has_histogram` is true if the histogram has already been computed.
  template <typename Key>
  void radix_pass(KernelSet& radix, const Pairs<Key>& from, const Pairs<Key>& to, const ElementCount& count,
                  std::uint32_t shift, bool has_histogram);

  OpenclDevice& device_;
  bool chunks_;
  CoreGroups core_groups_;
  // The kernels for groups exist for keys of 16 bits (narrow) and of 32 bits (wide). kernels_ contains the
  // narrow ones, and all kernels for chunks.
  KernelSet kernels_, wide_kernels_, narrow_radix_, wide_radix_;
  Scan scan_;
  Buffer<std::uint64_t> sums_, totals_;
  Words drawn_, pairs_;  // the values of ElementCount::counted, one element each
  Words histogram_, starts_, ids_a_;
  // Only the functions for chunks use the members up to largest_. CountLists writes the sums of the chunks to
  // chunk_sums_. It writes the pairs (key, index) of the visible splats to counted_, sorted by the first
  // digit of the key, which has first_bits_ bits. The later passes of the sort write to pairs_a_ and
  // pairs_b_. least_ and largest_ are the smallest and the largest key.
  Buffer<ChunkSums> chunk_sums_;
  Buffer<std::uint64_t> counted_, pairs_a_, pairs_b_;
  std::uint32_t first_bits_ = 0, least_ = 0, largest_ = 0;
  Words keys_a_, keys_b_, ids_b_;                    // groups only
  Words digits_, area_sums_;                         // groups only
  Words tiles_a_, tiles_b_, pair_ids_, pair_slots_;  // groups only; one element per intersection
};

}  // namespace ubs::opencl
