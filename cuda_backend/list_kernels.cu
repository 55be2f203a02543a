// SPDX-License-Identifier: Apache-2.0
// Tile lists, the kernels around the sorts and prefix sums of device_algorithms.cu: choice of the drawn
// splats, emission of (tile, splat) in depth order, slots and first intersection of each tile.
// Forward only, slots and their offsets are null pointers and not written. Bounded, the host does not know
// how much there is: launches and sorts are for a bound, behind what is there stand the largest keys, which
// stay behind.
#include <cuda_runtime.h>

#include "cuda_backend/kernels.hpp"

namespace ubs::cuda {
namespace {

struct TileRect {
  u32 x0, y0, width, height;
};
__device__ __forceinline__ TileRect tile_rect(const u32* tile_rects, u32 splat) {
  const uint2 packed = reinterpret_cast<const uint2*>(tile_rects)[splat];
  const u32 x0 = packed.x & 0xffffu, y0 = packed.y & 0xffffu;
  return {x0, y0, (packed.x >> 16) - x0 + 1, (packed.y >> 16) - y0 + 1};
}

__device__ __forceinline__ size_t global_index() {
  return static_cast<size_t>(blockIdx.x) * blockDim.x + threadIdx.x;
}

constexpr u32 kLargestKey = 0xffffffffu;

// Lists the splats that are drawn, in their order, and behind them as many largest keys as there are others: what is sorted may be a bound.
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
  if (listed) visible_ids[place] = static_cast<u32>(i);
  keys[place] = listed ? depth_keys[i] : kLargestKey;
  if (i + 1 == count) {
    totals[0] = drawn_before + (tiles > 0 ? 1 : 0);
    totals[1] = tiles_before > most - tiles ? most : tiles_before + tiles;
  }
}

// Takes the numbers that the other kernels go by from the totals, or, where there are more intersections than
// room, makes the view one without splats: no kernel guards its writes, and all after it is the work of an
// empty view.
__global__ void fit_lists(const u64* totals, u64 room, u32 count, u32* tile_counts, u32* drawn, u32* pairs) {
  const size_t i = global_index();
  const bool fits = totals[1] <= room;
  if (i == 0) {
    *drawn = fits ? static_cast<u32>(totals[0]) : 0;
    *pairs = fits ? static_cast<u32>(totals[1]) : 0;
  }
  if (!fits && i < count) tile_counts[i] = 0;
}

template <bool bounded>
__device__ __forceinline__ u32 amount(u32 most, const u32* counted) {
  return bounded ? *counted : most;
}

// Tiles of each splat in depth order; their prefix sum places the intersections.
template <bool bounded>
__global__ void gather_areas(const u32* order, u32 most, const u32* counted, const u32* tile_rects,
                             u32* areas) {
  const size_t i = global_index();
  if (i < amount<bounded>(most, counted)) {
    const TileRect rect = tile_rect(tile_rects, order[i]);
    areas[i] = rect.width * rect.height;
  } else if (bounded && i < most) {
    areas[i] = 0;
  }
}

// The i with firsts[i] <= place < firsts[i + 1], in [low, high); firsts ascends strictly.
__device__ __forceinline__ u32 find_owner(const u32* firsts, u32 low, u32 high, u32 place) {
  while (high - low > 1) {
    const u32 middle = low + (high - low) / 2;
    if (firsts[middle] <= place)
      low = middle;
    else
      high = middle;
  }
  return low;
}

// Balanced whatever the sizes of the rectangles: a thread finds its splat by bisection, first for the block
// as a whole, then between the block's ends.
template <bool bounded>
__global__ void __launch_bounds__(kListBlock)
    emit_intersections(const u32* order, const u32* firsts, u32 most_drawn, const u32* drawn, u32 most_pairs,
                       const u32* pairs, const u32* tile_rects, u32 tiles_x, u32* tiles, u32* ids) {
  __shared__ u32 ends[2];
  const u32 count = amount<bounded>(most_drawn, drawn), intersections = amount<bounded>(most_pairs, pairs);
  const u32 me = threadIdx.x;
  const size_t begin = static_cast<size_t>(blockIdx.x) * blockDim.x, place = begin + me;
  if (me < 2) {
    const size_t end = begin + blockDim.x < intersections ? begin + blockDim.x : intersections;
    ends[me] = find_owner(firsts, 0, count, static_cast<u32>(me == 0 ? begin : end - 1));
  }
  __syncthreads();
  if (bounded && place >= intersections && place < most_pairs) {
    tiles[place] = kLargestKey;
    ids[place] = 0;
  }
  if (place >= intersections) return;
  const u32 i = find_owner(firsts, ends[0], ends[1] + 1, static_cast<u32>(place));
  const u32 number = static_cast<u32>(place) - firsts[i], id = order[i];
  const TileRect rect = tile_rect(tile_rects, id);
  const u32 row = number / rect.width;
  tiles[place] = (rect.y0 + row) * tiles_x + rect.x0 + (number - row * rect.width);
  ids[place] = id;
}

// One thread an intersection and one more. The slot follows from tile and rectangle, so that the sort moves
// 8 bytes an intersection instead of 12. The thread at which a tile begins writes that tile's range, and
// those of the empty tiles before it.
template <bool bounded>
__global__ void finish_lists(const u32* tiles_sorted, const u32* ids, u32 most_pairs, const u32* pairs,
                             u32 tiles, u32 tiles_x, const u32* tile_rects, const u32* slot_offsets,
                             u32* slots, u32* tile_ranges) {
  const u32 intersections = amount<bounded>(most_pairs, pairs);
  const size_t i = global_index();
  if (i > intersections) return;
  const u32 from = i == 0 ? 0 : tiles_sorted[i - 1] + 1;
  const u32 tile = i == intersections ? tiles : tiles_sorted[i];
  for (u32 t = from; t <= tile; ++t) tile_ranges[t] = static_cast<u32>(i);
  if (i == intersections || !slots) return;
  const u32 id = ids[i], row = tile / tiles_x;
  const TileRect rect = tile_rect(tile_rects, id);
  slots[i] = slot_offsets[id] + (row - rect.y0) * rect.width + (tile - row * tiles_x - rect.x0);
}

template <bool bounded>
ListKernels kernels() {
  return {write_counts, fit_lists, gather_areas<bounded>, emit_intersections<bounded>, finish_lists<bounded>};
}

}  // namespace

ListKernels list_kernels(bool bounded) { return bounded ? kernels<true>() : kernels<false>(); }

std::vector<int> compiled_capabilities() {
  std::vector<int> all{__CUDA_ARCH_LIST__};  // 900 for sm_90
  for (int& capability : all) capability /= 10;
  return all;
}

}  // namespace ubs::cuda
