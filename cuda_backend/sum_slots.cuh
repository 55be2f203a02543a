// SPDX-License-Identifier: Apache-2.0
// Gradient of a projected splat = sum of its slots: up to kWideSplat of them in slot order; of more,
// kSumParts parts side by side, part k every kSumParts-th slot from the k-th on in slot order, then the parts
// in theirs.

constexpr int kSumThreads = 256;  // a block
constexpr int kSumSplats = kSumThreads / kGradStride, kSumParts = 16;
constexpr unsigned kWideSplat = 64;
static_assert(kSumParts == kSumSplats && kGradStride == 16);  // 16 threads a splat, or a part

// Every `step`-th slot. Those of mask 0 were never written: they may hold anything, NaN included.
__device__ __forceinline__ float sum_of_slots(size_t first, size_t last, unsigned step, unsigned value,
                                              const float* slots, const unsigned short* masks) {
  float sum = 0.0f;
  for (size_t slot = first; slot < last; slot += step)
    if (masks[slot] != 0) sum += slots[static_cast<size_t>(slot) * kGradStride + value];
  return sum;
}

// 16 neighbouring threads a splat, so that a slot is one coalesced read; all of the block a splat with many
// slots.
UBS_KERNEL void __launch_bounds__(kSumThreads)
    sum_slots(unsigned count, const unsigned* tile_counts, const unsigned* slot_offsets, const float* slots,
              const unsigned short* masks, float* v_records) {
  __shared__ unsigned wide[kSumThreads / 32];  // of the two splats of a warp, as bits 0 and 16
  __shared__ float parts[kSumParts * kGradStride];
  const unsigned me = threadIdx.x, mine = me / kGradStride, value = me % kGradStride;
  const size_t first_splat = static_cast<size_t>(blockIdx.x) * kSumSplats, splat = first_splat + mine;
  const unsigned tiles = splat < count ? tile_counts[splat] : 0;
  const unsigned wide_lanes = __ballot_sync(kWholeWarp, tiles > kWideSplat);
  if (me % 32 == 0) wide[me / 32] = wide_lanes;
  if (splat < count && tiles <= kWideSplat) {
    const size_t first = tiles > 0 ? slot_offsets[splat] : 0;
    v_records[splat * kGradStride + value] = sum_of_slots(first, first + tiles, 1, value, slots, masks);
  }
  __syncthreads();
  for (int s = 0; s < kSumSplats; ++s) {
    if ((wide[s / 2] >> (s % 2 * 16) & 1u) == 0) continue;  // the same in the whole block
    const size_t first = slot_offsets[first_splat + s], last = first + tile_counts[first_splat + s];
    parts[me] = sum_of_slots(first + mine, last, kSumParts, value, slots, masks);
    __syncthreads();
    if (mine == 0) {
      float sum = 0.0f;
      for (int part = 0; part < kSumParts; ++part) sum += parts[part * kGradStride + value];
      v_records[(first_splat + s) * kGradStride + value] = sum;
    }
    __syncthreads();
  }
}
