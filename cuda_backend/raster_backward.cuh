// SPDX-License-Identifier: Apache-2.0
// Backward rasteriser: a block a segment of a tile's list (kernels/map/list_segments.h), a thread a pixel, front to
// back as in forward (kernels/math/blend.h). Splats that no pixel of the tile composites (mask 0) are squeezed out
// first. The ten sums of a splat are taken in a fixed order: 16 pixels of a block by shuffles, then its blocks one after
// the other. Each (tile, splat) is written once, to its own slot.

constexpr int kQueue = kTilePixels;  // list entries looked at together
constexpr int kQueueWords = kQueue / 32;

// 32 KiB, so that three blocks have room on cards with 100 KiB (a KiB of each is the driver's), two on Turing
// with 64.
struct BackwardShared {
  SplatBatch<kQueue> batch;
  unsigned targets[kQueue];  // slot of the entry
  union {
    unsigned hits[kBlocks * kQueueWords];
    unsigned kept[kWarps];  // entries with a mask, by warp: read before the hits are written
  };
  float partial[32 * kBlocks * kSums];  // of 32 splats, one set of sums a block of pixels
  unsigned short masks[kQueue];
};
static_assert(sizeof(BackwardShared) == 32768);

// Sums over the 16 lanes of each half-warp of ten values at once: at each step a lane hands over the half of
// its values that its partner keeps, so that 11 shuffles do instead of 40. Lane `l` ends with the sum of
// value sum_index(l); a fixed tree, so the same bits every time.
__device__ __forceinline__ float exchange(float low, float high, bool keeps_high, int distance) {
  const float given = keeps_high ? low : high, kept = keeps_high ? high : low;
  return kept + __shfl_xor_sync(kWholeWarp, given, distance);
}
__device__ __forceinline__ float half_warp_sums(const float (&v)[kSums], int lane) {
  float a[5], b[3];
  const bool upper8 = (lane & 8) != 0, upper4 = (lane & 4) != 0, upper2 = (lane & 2) != 0;
#pragma unroll
  for (int i = 0; i < 5; ++i) a[i] = exchange(v[i], v[5 + i], upper8, 8);
  b[0] = exchange(a[0], a[3], upper4, 4);
  b[1] = exchange(a[1], a[4], upper4, 4);
  b[2] = exchange(a[2], 0.0f, upper4, 4);
  const float c0 = exchange(b[0], b[2], upper2, 2), c1 = exchange(b[1], 0.0f, upper2, 2);
  return exchange(c0, c1, (lane & 1) != 0, 1);
}
// Which of the ten values lane l holds afterwards; -1: none.
__device__ __forceinline__ int sum_index(int lane) {
  const int local = lane & 3, third = (lane & 4) != 0 ? 3 : 0;
  const bool holds = third == 0 ? local < 3 : local < 2;
  return holds ? ((lane & 8) != 0 ? 5 : 0) + third + local : -1;
}

// Fills the queue with those of the 256 list entries from `at` on that have a mask, in list order, and
// returns their number.
__device__ __forceinline__ int fill_queue(BackwardShared& shared, unsigned at, unsigned last,
                                          const float* records, const unsigned* sorted_ids,
                                          const unsigned* sorted_slots, const unsigned short* masks,
                                          int thread) {
  const int lane = thread % 32, warp = thread / 32;
  const unsigned mine = at + static_cast<unsigned>(thread);
  unsigned slot = 0, mask = 0;
  if (mine < last) {
    slot = sorted_slots[mine];
    mask = masks[slot];
  }
  const unsigned kept = __ballot_sync(kWholeWarp, mask != 0);
  if (lane == 0) shared.kept[warp] = static_cast<unsigned>(__popc(kept));
  __syncthreads();
  unsigned place = static_cast<unsigned>(__popc(kept & ((1u << lane) - 1u))), total = 0;
#pragma unroll
  for (int w = 0; w < kWarps; ++w) {
    if (w == warp) place += total;
    total += shared.kept[w];
  }
  if (mask != 0) {
    put_splat(shared.batch, static_cast<int>(place), load_splat(records, sorted_ids[mine]));
    shared.targets[place] = slot;
    shared.masks[place] = static_cast<unsigned short>(mask);
  }
  __syncthreads();
  const int entry = thread;
  transpose_blocks(entry < static_cast<int>(total) ? shared.masks[entry] : 0u, shared.hits + warp,
                   kQueueWords, lane);
  __syncthreads();
  return static_cast<int>(total);
}

// The 16 threads of a half-warp sum the parts of one splat over its blocks and write its slot.
__device__ __forceinline__ void write_slot(const BackwardShared& shared, int entry, bool exists, int thread,
                                           float* slots) {
  const int value = thread % kHalfWarp;
  float sum = 0.0f;
  if (exists && value < kSums) {
    const float* parts = shared.partial + (entry % 32) * kBlocks * kSums + value;
    for (unsigned blocks = shared.masks[entry]; blocks != 0; blocks &= blocks - 1)
      sum += parts[(__ffs(static_cast<int>(blocks)) - 1) * kSums];
  }
  const float hp = __shfl_sync(kWholeWarp, sum, 0, kHalfWarp);
  if (!exists) return;
  const float out = slot_value(value, sum, hp, blend_factors(batch_splat(shared.batch, entry).splat));
  slots[static_cast<size_t>(shared.targets[entry]) * kGradStride + static_cast<size_t>(value)] = out;
}

// The 32 queue entries of one word. Both halves of a warp go on until neither has a splat left, so that every
// shuffle has all its lanes.
__device__ __forceinline__ void visit_word(BackwardShared& shared, int word, int block, int lane,
                                           PixelState& p) {
  const int value = sum_index(lane % kHalfWarp);
  unsigned bits = shared.hits[block * kQueueWords + word];
  while (__any_sync(kWholeWarp, bits != 0)) {
    const bool active = bits != 0;
    const int k = active ? __ffs(static_cast<int>(bits)) - 1 : 0;
    bits &= bits - 1;
    const BlendSums v = visit(blend_no_sums(), batch_splat(shared.batch, word * 32 + k), active, p);
    const float values[kSums] = {v.hp, v.hq, v.hpp, v.hpq, v.hqq, v.opacity, v.log_beta, v.r, v.g, v.b};
    const float sum = half_warp_sums(values, lane);
    if (active && value >= 0) shared.partial[(k * kBlocks + block) * kSums + value] = sum;
  }
}

UBS_KERNEL void __launch_bounds__(kQueue)
    raster_backward(const float* records, const unsigned* sorted_ids, const unsigned* sorted_slots,
                    const unsigned* tile_ranges, int tiles_x, int tiles_y, int width, int height,
                    const float* image, const float* v_image, const unsigned short* masks, const float* states,
                    float* slots) {
  __shared__ BackwardShared shared;
  const ListSegment segment = list_segment(tile_ranges, tiles_x * tiles_y, blockIdx.x);
  if (segment.first == segment.last) return;
  const int thread = static_cast<int>(threadIdx.x);
  const TilePixel pixel = tile_pixel(segment.tile, thread, tiles_x, width, height);
  float4 state = make_float4(pixel.inside ? 1.0f : 0.0f, 0.0f, 0.0f, 0.0f);
  if (segment.number > 0)
    state = reinterpret_cast<const float4*>(states)[size_t{segment.states} * kTilePixels + thread];
  const int plane = tiles_x * kTileSide * tiles_y * kTileSide;
  PixelState p = start_pixel(pixel, plane, image, v_image, state);

  for (unsigned at = segment.first; at < segment.last; at += kQueue) {
    const int entries = fill_queue(shared, at, segment.last, records, sorted_ids, sorted_slots, masks, thread);
    for (int word = 0; word * 32 < entries; ++word) {
      visit_word(shared, word, pixel.block, thread % 32, p);
      __syncthreads();
      for (int entry = word * 32 + thread / kHalfWarp; entry < word * 32 + 32; entry += kQueue / kHalfWarp)
        write_slot(shared, entry, entry < entries, thread, slots);
      __syncthreads();
    }
  }
}
