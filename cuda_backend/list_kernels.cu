// SPDX-License-Identifier: Apache-2.0
// The kernels that build the tile lists, together with the sorts and prefix sums of device_algorithms.cu.
// They select the visible splats, write pairs of tile and splat in depth order, and compute the slot of each
// pair and the first pair of each tile. A pair of tile and splat is called an intersection.
// If there is no backward pass, the pointers to slots and slot offsets are null, and these are not written.
// If the host does not know the numbers of elements (kernels/map/tile_rect.h), launches and sorts are sized
// for upper bounds. The unused elements get the largest key, so that the sort leaves them at the end.
#include <cuda_runtime.h>
#include <math.h>

#include "cuda_backend/cuda_kernels.hpp"
#include "kernels/layout.h"

namespace ubs::cuda {
namespace {

// clang-format off
#include "kernels/dialect/dialect.h"
#include "kernels/dialect/entry.h"
#include "kernels/map/tile_rect.h"
#include "kernels/map/lists.cl"
#include "kernels/map/drawn.cl"
// clang-format on

__device__ __forceinline__ TileRect rect_of(const u32* tile_rects, u32 splat) {
  return tile_rect(reinterpret_cast<const uint2*>(tile_rects)[splat]);
}

__device__ __forceinline__ size_t global_index() {
  return static_cast<size_t>(blockIdx.x) * blockDim.x + threadIdx.x;
}

constexpr u32 kLargestKey = 0xffffffffu;

// Writes the indices of the visible splats in ascending order, with their depths as keys. The other splats
// follow with the largest key, because the number of elements to sort may be an upper bound. The thread of
// the last splat also writes the total numbers of visible splats and of intersections.
__global__ void write_counts(const u32* tile_counts, const u32* depth_keys, u32 count, u32 bits,
                             const u64* before, u32* visible_ids, u32* keys, u32* slot_offsets, u64* totals) {
  const size_t i = global_index();
  if (i >= count) return;
  const u32 tiles = tile_counts[i];
  const u64 tiles_before = before[i] >> bits, most = ~0ull >> bits;
  const u32 drawn_before = static_cast<u32>(before[i]) & static_cast<u32>((1ull << bits) - 1);
  if (slot_offsets) slot_offsets[i] = static_cast<u32>(tiles_before);
  const bool listed = tiles > 0;
  const u32 others_before = static_cast<u32>(i) - drawn_before;
  const size_t place = listed ? drawn_before : count - 1 - others_before;
  visible_ids[place] = static_cast<u32>(i);
  keys[place] = listed ? depth_keys[i] : kLargestKey;
  if (i + 1 == count) {
    totals[0] = drawn_before + (tiles > 0 ? 1 : 0);
    totals[1] = tiles_before > most - tiles ? most : tiles_before + tiles;
  }
}

// Computes the number of tiles of each splat in depth order, and 0 for unused elements. The prefix sums of
// these numbers are the indices of the first intersections of the splats.
__global__ void gather_areas(const u32* order, u32 most, const u32* counted, const u32* tile_rects, u32* areas) {
  const size_t i = global_index();
  if (i >= most) return;
  areas[i] = i < listed(most, counted) ? tile_rect_area(rect_of(tile_rects, order[i])) : 0;
}

// Writes the intersections, with one thread per intersection, so that the work is balanced for rectangles of
// any size. In each block, two threads first find the splats of the block's first and last intersection by
// bisection. Then each thread finds the splat of its own intersection by bisection between these two splats.
template <typename Key>
__global__ void __launch_bounds__(kListBlock)
    emit_intersections(const u32* order, const u32* firsts, u32 most_drawn, const u32* drawn, u32 most_pairs,
                       const u32* pairs, const u32* tile_rects, u32 tiles_x, Key* tiles, u32* ids,
                       u32* long_lists) {
  __shared__ u32 ends[2];
  const u32 count = listed(most_drawn, drawn), intersections = listed(most_pairs, pairs);
  const u32 me = threadIdx.x;
  const size_t begin = static_cast<size_t>(blockIdx.x) * blockDim.x, place = begin + me;
  if (me < 2) {
    const size_t end = begin + blockDim.x < intersections ? begin + blockDim.x : intersections;
    ends[me] = find_owner(firsts, 0, count, me == 0 ? begin : end - 1);
  }
  __syncthreads();
  if (place == 0 && long_lists) *long_lists = 0;
  if (place >= intersections && place < most_pairs) {
    tiles[place] = static_cast<Key>(kLargestKey);
    ids[place] = 0;
  }
  if (place >= intersections) return;
  const u32 i = find_owner(firsts, ends[0], ends[1] + 1, place);
  const u32 number = static_cast<u32>(place) - firsts[i], id = order[i];
  const TileRect rect = rect_of(tile_rects, id);
  const u32 width = tile_rect_width(rect), row = number / width;
  tiles[place] = static_cast<Key>((rect.y0 + row) * tiles_x + rect.x0 + (number - row * width));
  ids[place] = id;
}

// Computes the slot of each intersection and the range of list entries of each tile, with one thread per
// intersection and one additional thread. The slot is computed from the tile and the rectangle of the splat,
// so that the sort moves 8 instead of 12 bytes per intersection. The thread of the first entry in a tile's
// list writes the range of this tile and the ranges of the empty tiles before it. A bisection for each tile
// would take longer (docs/results/2026-11-27-h200-slots.md).
// Sets *long_lists to 1 if a list has more than kLongList entries. emit_intersections has set it to 0 before.
template <typename Key>
__global__ void finish_lists(const Key* tiles_sorted, const u32* ids, u32 most_pairs, const u32* pairs,
                             u32 tiles, u32 tiles_x, const u32* tile_rects, const u32* slot_offsets,
                             u32* slots, u32* tile_ranges, u32* long_lists) {
  const u32 intersections = listed(most_pairs, pairs);
  const size_t i = global_index();
  if (i > intersections) return;
  const u32 from = i == 0 ? 0 : tiles_sorted[i - 1] + 1;
  const u32 tile = i == intersections ? tiles : tiles_sorted[i];
  for (u32 t = from; t <= tile; ++t) tile_ranges[t] = static_cast<u32>(i);
  if (long_lists && from <= tile && intersections - i > kLongList && tiles_sorted[i + kLongList] == tile)
    atomicOr(long_lists, 1u);
  if (i == intersections || !slots) return;
  const u32 id = ids[i], row = tile / tiles_x;
  const TileRect rect = rect_of(tile_rects, id);
  slots[i] = slot_offsets[id] + (row - rect.y0) * tile_rect_width(rect) + (tile - row * tiles_x - rect.x0);
}

}  // namespace

ListKernels list_kernels() {
  return {write_counts,
          clamp_to_capacity,
          gather_areas,
          {emit_intersections<u16>, finish_lists<u16>},
          {emit_intersections<u32>, finish_lists<u32>}};
}

DrawnTable drawn_kernels() { return {mark_drawn, pick_drawn, unpack_drawn, spread_gradient}; }

std::vector<int> compiled_capabilities() {
  std::vector<int> all{__CUDA_ARCH_LIST__};  // 900 for sm_90
  for (int& capability : all) capability /= 10;
  return all;
}

}  // namespace ubs::cuda
