// SPDX-License-Identifier: Apache-2.0
#include "cuda_backend/lists.hpp"

#include <array>
#include <bit>

#include "cuda_backend/grid.hpp"

namespace ubs::cuda {
namespace {

constexpr int kKeyBits = 32;  // 31 would do for positive floats, but take as many passes of 8 bits

dim3 grid(std::uint64_t items) { return {blocks(items, kListBlock), 1, 1}; }

}  // namespace

ListTotals Lists::count(const CountLists& lists) {
  if (lists.count == 0) return {};
  reserve(device_, before_, "tile list sums", lists.count);
  reserve(device_, totals_, "tile list totals", 2);
  device_.algorithm("count_scan", [&](Workspace& workspace) {
    return scan_counts(workspace, pointer_of(lists.tile_counts), pointer_of(before_.view()), lists.count,
                       device_.stream());
  });
  device_.launch("write_counts", kernels_.write_counts, grid(lists.count), kListBlock, lists.tile_counts,
                 lists.count, static_cast<u32>(!view_cull_), before_.view(), lists.visible_ids, lists.slot_offsets,
                 reinterpret_cast<u64*>(pointer_of(totals_.view())));
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
  const auto drawn = static_cast<u32>(lists.totals.visible),
             pairs = static_cast<u32>(lists.totals.intersections);
  // The key of what is not drawn is the largest.
  if (drawn > 0) sort_by_depth(lists, view_cull_ ? drawn : lists.count);
  place(lists, drawn, pairs);
}

void Lists::sort_by_depth(const BuildLists& lists, u32 splats) {
  reserve(device_, keys_, "depth keys to sort", splats);
  reserve(device_, keys_sorted_, "sorted depth keys", splats);
  reserve(device_, order_, "depth order", splats);
  device_.launch("gather_keys", kernels_.gather_keys, grid(splats), kListBlock, lists.visible_ids, splats,
                 lists.depth_keys, keys_.view());
  device_.algorithm("sort_depth", [&](Workspace& workspace) {
    return sort_pairs(workspace, pointer_of(keys_.view()), pointer_of(keys_sorted_.view()),
                      pointer_of(lists.visible_ids), pointer_of(order_.view()), splats, kKeyBits - sort_bits_, kKeyBits,
                      device_.stream());
  });
}

void Lists::place(const BuildLists& lists, u32 drawn, u32 pairs) {
  const auto tiles = static_cast<u32>(lists.shape.tiles()), tiles_x = static_cast<u32>(lists.shape.tiles_x());
  reserve(device_, tiles_sorted_, "sorted tiles", pairs);
  if (pairs > 0) {
    reserve(device_, tiles_, "tiles to sort", pairs);
    reserve(device_, pair_ids_, "splats to sort", pairs);
    // The sorted keys are no longer needed: their memory takes the areas, the unsorted keys' the places.
    const View1<u32> areas = keys_sorted_.view(), firsts = keys_.view();
    device_.launch("gather_areas", kernels_.gather_areas, grid(drawn), kListBlock, order_.view(), drawn,
                   lists.tile_rects, areas);
    device_.algorithm("place_scan", [&](Workspace& workspace) {
      return scan_exclusive(workspace, pointer_of(areas), pointer_of(firsts), drawn, device_.stream());
    });
    device_.launch("emit_intersections", kernels_.emit, grid(pairs), kListBlock, order_.view(), firsts, drawn,
                   pairs, lists.tile_rects, tiles_x, tiles_.view(), pair_ids_.view());
    device_.algorithm("sort_tiles", [&](Workspace& workspace) {
      return sort_pairs(workspace, pointer_of(tiles_.view()), pointer_of(tiles_sorted_.view()),
                        pointer_of(pair_ids_.view()), pointer_of(lists.sorted_ids), pairs, 0,
                        std::max(1, static_cast<int>(std::bit_width(tiles - 1))), device_.stream());
    });
  }
  device_.launch("finish_lists", kernels_.finish, grid(pairs + std::uint64_t{1}), kListBlock,
                 tiles_sorted_.view(), lists.sorted_ids, pairs, tiles, tiles_x, lists.tile_rects,
                 lists.slot_offsets, lists.sorted_slots, lists.tile_ranges);
}

}  // namespace ubs::cuda
