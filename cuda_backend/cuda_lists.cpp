// SPDX-License-Identifier: Apache-2.0
#include "cuda_backend/cuda_lists.hpp"

#include <array>
#include <bit>

#include "cuda_backend/grid.hpp"
#include "host/device/stage_sizes.hpp"

namespace ubs::cuda {
namespace {

// Positive floats need only 31 bits, but sorting by 31 bits would also take four passes of 8 bits.
constexpr int kKeyBits = 32;

dim3 grid(std::uint64_t items) { return {blocks(items, kListBlock), 1, 1}; }

}  // namespace

ListTotals Lists::run(const CountLists& lists) {
  const bool waits = lists.totals.size == 0;
  if (lists.count == 0 && waits) return {};
  if (waits) reserve(device_, totals_, "tile list totals", 2);
  const BufferView<std::uint64_t> totals_at = waits ? totals_.view() : lists.totals;
  if (lists.count > 0) {
    const auto bits = static_cast<u32>(std::bit_width(lists.count));
    reserve(device_, before_, "tile list sums", lists.count);
    reserve(device_, visible_, "visible splats", lists.count);
    reserve(device_, keys_, "depth keys to sort", lists.count);
    device_.algorithm("count_scan", [&](Workspace& workspace) {
      return scan_counts(workspace, pointer_of(lists.tile_counts), pointer_of(before_.view()), lists.count,
                         bits, device_.stream());
    });
    device_.launch("write_counts", kernels_.write_counts, grid(lists.count), kListBlock, lists.tile_counts,
                   lists.depth_keys, lists.count, bits, before_.view(), visible_.view(), keys_.view(),
                   lists.slot_offsets, totals_at);
  } else {
    device_.fill_zero(*totals_at.memory, 0, 2 * sizeof(std::uint64_t));
  }
  if (!waits) {
    fit(lists);
    return lists.room;
  }
  std::array<std::uint64_t, 2> totals{};
  totals_.download(std::span<std::uint64_t>(totals));
  return {totals[0], totals[1]};
}

void Lists::fit(const CountLists& lists) {
  reserve(device_, drawn_, "tile list sums", 1);
  reserve(device_, pairs_, "tile list sums", 1);
  const dim3 all = grid(std::max(lists.count, 1u));
  device_.launch("clamp_to_capacity", kernels_.fit, all, kListBlock, lists.totals, lists.room.visible,
                 lists.room.intersections, lists.count, all.x * kListBlock, lists.tile_counts, drawn_.view(),
                 pairs_.view());
}

void Lists::run(const BuildLists& lists) {
  if (lists.totals.intersections > UINT32_MAX || lists.totals.visible > lists.count ||
      lists.shape.tiles() < 1)
    fail(ErrorKind::internal,
         "tile lists: invalid sizes: {} intersections (at most {}), {} visible splats (at most {}), {} tiles "
         "(at least 1)",
         lists.totals.intersections, UINT32_MAX, lists.totals.visible, lists.count, lists.shape.tiles());
  const auto drawn = static_cast<u32>(lists.totals.visible),
             pairs = static_cast<u32>(lists.totals.intersections);
  const Job job = lists.bounded ? Job{lists, {drawn, drawn_.view()}, {pairs, pairs_.view()}}
                                : Job{lists, {drawn}, {pairs}};
  if (drawn > 0) sort_by_depth(drawn);
  if (lists.shape.tiles() <= stage_sizes::kMaxNarrowTiles)
    place(job, kernels_.narrow);
  else
    place(job, kernels_.wide);
}

void Lists::sort_by_depth(u32 splats) {
  reserve(device_, keys_sorted_, "sorted depth keys", splats);
  reserve(device_, order_, "depth order", splats);
  device_.algorithm("sort_depth", [&](Workspace& workspace) {
    return sort_pairs(workspace, pointer_of(keys_.view()), pointer_of(keys_sorted_.view()),
                      pointer_of(visible_.view()), pointer_of(order_.view()), splats, 0, kKeyBits,
                      device_.stream());
  });
}

template <typename Key>
void Lists::place(const Job& job, const TileKernels<Key>& kernels) {
  const BuildLists& lists = job.lists;
  const u32 drawn = job.drawn.most, pairs = job.pairs.most;
  const auto tiles = static_cast<u32>(lists.shape.tiles()), tiles_x = static_cast<u32>(lists.shape.tiles_x());
  constexpr std::size_t kEach = sizeof(u32) / sizeof(Key);  // keys per word
  const auto keys = [&](Buffer<u32>& buffer) { return BufferView<Key>{buffer.view().memory, pairs}; };
  reserve(device_, tiles_sorted_, "sorted tiles", (pairs + kEach - 1) / kEach);
  if (drawn > 0 && pairs > 0) {
    reserve(device_, tiles_, "tiles to sort", (pairs + kEach - 1) / kEach);
    reserve(device_, pair_ids_, "splats to sort", pairs);
    // The depth keys are no longer needed, so their two buffers are reused: `areas` receives the number of
    // tiles of each splat, and `firsts` the index of the first intersection of each splat.
    const BufferView<u32> areas = keys_sorted_.view(), firsts = keys_.view();
    device_.launch("gather_areas", kernels_.gather_areas, grid(drawn), kListBlock, order_.view(), drawn,
                   job.drawn.counted, lists.tile_rects, areas);
    device_.algorithm("place_scan", [&](Workspace& workspace) {
      return scan_exclusive(workspace, pointer_of(areas), pointer_of(firsts), drawn, device_.stream());
    });
    device_.launch("emit_intersections", kernels.emit, grid(pairs), kListBlock, order_.view(), firsts, drawn,
                   job.drawn.counted, pairs, job.pairs.counted, lists.tile_rects, tiles_x, keys(tiles_),
                   pair_ids_.view(), lists.long_lists);
    device_.algorithm("sort_tiles", [&](Workspace& workspace) {
      return sort_pairs(workspace, pointer_of(keys(tiles_)), pointer_of(keys(tiles_sorted_)),
                        pointer_of(pair_ids_.view()), pointer_of(lists.sorted_ids), pairs, 0,
                        std::max(1, static_cast<int>(std::bit_width(tiles - 1))), device_.stream());
    });
  }
  device_.launch("finish_lists", kernels.finish, grid(pairs + std::uint64_t{1}), kListBlock,
                 keys(tiles_sorted_), lists.sorted_ids, pairs, job.pairs.counted, tiles, tiles_x,
                 lists.tile_rects, lists.slot_offsets, lists.sorted_slots, lists.tile_ranges,
                 lists.long_lists);
}

}  // namespace ubs::cuda
