// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/lists.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <span>
#include <string>
#include <utility>

namespace ubs::opencl {
namespace {

// Four passes. 11 bits and three passes are no faster on CPUs at 30K .. 300K splats and half as fast at 3M,
// where 2 x 2048 open cache lines and pages are too many; on GPUs the bins are the work-items of a group.
constexpr std::uint32_t kRadixBits = 8;
constexpr std::uint32_t kKeyBits = 32;
constexpr std::size_t kMostBins = std::size_t{16} << 20;  // (chunk, bin) histogram: 64 MiB
constexpr std::uint32_t kColumnBlock = 2048;              // columns of a histogram that a work-item scans

ProgramSpec list_program(const KernelConfig& config) {
  ProgramSpec spec{{"opencl/group_scan.cl", "opencl/tile_rect.cl", "opencl/tile_lists.cl"}, {"-DUBS_SUM=ulong"}};
  if (config.raster == RasterKind::cpu)
    spec = {{"opencl/tile_rect.cl", "opencl/tile_list_chunks.cl"},
            {"-DUBS_RADIX_BITS=" + std::to_string(kRadixBits)}};
  if (!config.work.view_cull) spec.options.push_back("-DUBS_VIEW_CULL=0");
  if (!config.backward) spec.options.push_back("-DUBS_FORWARD_ONLY=1");
  return spec;
}

ProgramSpec radix_program() { return {{"opencl/group_scan.cl", "opencl/radix_sort.cl"}, {"-DUBS_SUM=uint"}}; }

Range grid(std::uint64_t items) { return {round_up(items, kGroupSize)}; }
constexpr Range kGroup{kGroupSize};

}  // namespace

Lists::Lists(OpenclDevice& device, const KernelConfig& config)
    : device_(device),
      chunks_(config.raster == RasterKind::cpu),
      view_cull_(config.work.view_cull),
      slots_(config.backward),
      kernels_(device, list_program(config)),
      radix_(device, radix_program()),
      scan_(device, config) {}

Blocks Lists::blocks(std::uint64_t elements) const {
  return chunks_ ? chunk_blocks(elements, most_chunks(device_.info())) : group_blocks(elements);
}

Lists::Words& Lists::scratch(Words& buffer, std::size_t size) {
  reserve(device_, buffer, "tile list scratch", std::max<std::size_t>(size, 1));
  return buffer;
}

ListTotals Lists::count(const CountLists& lists) {
  const Blocks blocks = this->blocks(lists.count);
  reserve(device_, sums_, "tile list sums", 2 * blocks.count + 1);
  reserve(device_, totals_, "tile list totals", 2);
  kernels_["count_sums"](blocks.global(), blocks.group(), lists.tile_counts, lists.count, blocks.size,
                         sums_.view());
  scan_.exclusive(sums_.view(), sums_.view(), static_cast<std::uint32_t>(2 * blocks.count));
  kernels_["count_write"](blocks.global(), blocks.group(), lists.tile_counts, lists.count, blocks.size,
                          sums_.view(), lists.visible_ids, lists.slot_offsets, totals_.view());
  std::array<std::uint64_t, 2> totals{};
  totals_.download(std::span<std::uint64_t>(totals));
  return {totals[0], totals[1]};
}

void Lists::build(const BuildLists& lists) {
  if (lists.totals.intersections > UINT32_MAX || lists.totals.visible > lists.count ||
      lists.shape.tiles() < 1)
    fail(ErrorKind::internal,
         "tile lists: {} intersections of {} among {} splats in {} tiles cannot be listed",
         lists.totals.intersections, lists.totals.visible, lists.count, lists.shape.tiles());
  const auto drawn = static_cast<std::uint32_t>(lists.totals.visible);
  const std::uint32_t sorted = view_cull_ ? drawn : lists.count;  // the key of what is not drawn is the largest
  if (chunks_)
    place_by_chunks(lists, drawn, depth_order_by_chunks(lists, sorted));
  else
    place_by_groups(lists, drawn, depth_order_by_groups(lists, sorted));
}

// ---- CPUs: chunks -------------------------------------------------------------------------------

View1<std::uint32_t> Lists::depth_order_by_chunks(const BuildLists& lists, std::uint32_t drawn) {
  constexpr std::uint32_t bins = 1u << kRadixBits;
  const Blocks blocks = this->blocks(drawn);
  const View1<std::uint32_t> histogram = scratch(histogram_, blocks.count * bins).view();
  const View1<std::uint32_t> starts = scratch(starts_, bins + 1).view();
  Pairs from{scratch(keys_a_, drawn).view(), lists.visible_ids, {}};
  Pairs to{scratch(keys_b_, drawn).view(), scratch(ids_b_, drawn).view(), {}};
  View1<std::uint32_t> spare = scratch(ids_a_, drawn).view();

  for (std::uint32_t shift = 0; shift < kKeyBits; shift += kRadixBits) {
    if (shift == 0)
      kernels_["radix_histogram_first"](blocks.global(), blocks.group(), lists.visible_ids, lists.depth_keys,
                                        drawn, blocks.size, from.keys, histogram);
    else
      kernels_["radix_histogram"](blocks.global(), blocks.group(), from.keys, drawn, blocks.size, shift,
                                  histogram);
    scan_columns(blocks.count, bins, starts);
    const bool last = shift + kRadixBits >= kKeyBits;
    kernels_["radix_scatter"](blocks.global(), blocks.group(), from.keys, from.values, drawn, blocks.size,
                              shift, histogram, starts, last ? View1<std::uint32_t>{} : to.keys, to.values);
    if (shift == 0) from.values = spare;  // visible_ids is input only
    std::swap(from, to);
  }
  return from.values;
}

void Lists::place_by_chunks(const BuildLists& lists, std::uint32_t drawn, View1<std::uint32_t> order) {
  const auto tiles = static_cast<std::uint32_t>(lists.shape.tiles());
  const auto tiles_x = static_cast<std::uint32_t>(lists.shape.tiles_x());
  // A row of the histogram is worth clearing only for as many intersections as it has tiles.
  const std::size_t cores = device_.info().compute_units;
  const std::size_t most = std::min({most_chunks(device_.info()), kMostBins / tiles,
                                     std::max<std::size_t>(cores, lists.totals.intersections / tiles)});
  const Blocks blocks = chunk_blocks(drawn, most);
  const View1<std::uint32_t> histogram = scratch(histogram_, blocks.count * tiles).view();
  kernels_["tile_histogram"](blocks.global(), blocks.group(), order, lists.tile_rects, drawn, blocks.size,
                             tiles_x, tiles, histogram);
  scan_columns(blocks.count, tiles, lists.tile_ranges);
  kernels_["tile_scatter"](blocks.global(), blocks.group(), order, lists.tile_rects, lists.slot_offsets,
                           drawn, blocks.size, tiles_x, tiles, histogram, lists.tile_ranges, lists.sorted_ids,
                           lists.sorted_slots);
}

// Leaves in histogram_ the place of each (chunk, bin) relative to its bin, in `starts` (bins + 1) the place
// of each bin.
void Lists::scan_columns(std::size_t chunks, std::uint32_t bins, View1<std::uint32_t> starts) {
  kernels_["column_scan"](Range{(bins + kColumnBlock - 1) / kColumnBlock}, Range{1}, histogram_.view(),
                          static_cast<std::uint32_t>(chunks), bins, kColumnBlock, starts);
  scan_.exclusive(starts, starts, bins);
}

// ---- GPUs: groups -------------------------------------------------------------------------------

View1<std::uint32_t> Lists::depth_order_by_groups(const BuildLists& lists, std::uint32_t drawn) {
  Pairs from{scratch(keys_a_, drawn).view(), lists.visible_ids, {}};
  Pairs to{scratch(keys_b_, drawn).view(), scratch(ids_b_, drawn).view(), {}};
  const View1<std::uint32_t> spare = scratch(ids_a_, drawn).view();
  kernels_["gather_keys"](grid(drawn), kGroup, lists.visible_ids, drawn, lists.depth_keys, from.keys);
  for (std::uint32_t shift = 0; shift < kKeyBits; shift += kRadixBits) {
    radix_pass(from, to, drawn, shift);
    if (shift == 0) from.values = spare;  // visible_ids is input only
    std::swap(from, to);
  }
  return from.values;
}

void Lists::place_by_groups(const BuildLists& lists, std::uint32_t drawn, View1<std::uint32_t> order) {
  const auto tiles = static_cast<std::uint32_t>(lists.shape.tiles());
  const auto tiles_x = static_cast<std::uint32_t>(lists.shape.tiles_x());
  const auto pairs = static_cast<std::uint32_t>(lists.totals.intersections);
  const View1<std::uint32_t> firsts = scratch(starts_, drawn + std::size_t{1}).view();
  kernels_["gather_areas"](grid(drawn), kGroup, order, drawn, lists.tile_rects, firsts);
  scan_.exclusive(firsts, firsts, drawn);

  Pairs from{scratch(tiles_a_, pairs).view(), lists.sorted_ids, lists.sorted_slots};
  Pairs to{scratch(tiles_b_, pairs).view(), scratch(pair_ids_, pairs).view(),
           slots_ ? scratch(pair_slots_, pairs).view() : View1<std::uint32_t>{}};
  const auto bits = static_cast<std::uint32_t>(std::bit_width(tiles - 1));
  // An even number of passes ends where it began, an odd one on the other side.
  if ((bits + kRadixBits - 1) / kRadixBits % 2 == 1) std::swap(from, to);
  kernels_["emit_intersections"](grid(pairs), kGroup, order, firsts, drawn, pairs, lists.tile_rects,
                                 lists.slot_offsets, tiles_x, from.keys, from.values, from.values2);
  for (std::uint32_t shift = 0; shift < bits; shift += kRadixBits) {
    radix_pass(from, to, pairs, shift);
    std::swap(from, to);
  }
  kernels_["find_ranges"](grid(tiles + std::uint64_t{1}), kGroup, from.keys, pairs, tiles, lists.tile_ranges);
}

void Lists::radix_pass(const Pairs& from, const Pairs& to, std::uint32_t count, std::uint32_t shift) {
  if (count == 0) return;
  const Blocks blocks = group_blocks(count);
  const std::size_t bins = blocks.count << kRadixBits;
  const View1<std::uint32_t> histogram = scratch(histogram_, bins + 1).view();
  radix_["radix_histogram"](blocks.global(), blocks.group(), from.keys, count, shift, histogram);
  scan_.exclusive(histogram, histogram, static_cast<std::uint32_t>(bins));
  radix_["radix_scatter"](blocks.global(), blocks.group(), from.keys, from.values, from.values2, count, shift,
                          histogram, to.keys, to.values, to.values2);
}

}  // namespace ubs::opencl
