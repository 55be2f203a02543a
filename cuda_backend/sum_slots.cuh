// SPDX-License-Identifier: Apache-2.0
// Gradient of a projected splat = sum of its slots, which are in one buffer.

#define UBS_SLOTS(type) type slots
#define UBS_SLOT_IN_PIECE(slot) (slot)
#define UBS_SLOT_PIECE(slot) slots
#include "kernels/map/slot_value.h"

constexpr int kSumThreads = 256;  // a block
constexpr int kSumSplats = kSumThreads / kGradStride;
static_assert(kSumParts == kSumSplats && kGradStride == 16);  // 16 threads a splat, or a part

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
    v_records[splat * kGradStride + value] =
        sum_of_value(tiles > 0 ? slot_offsets[splat] : 0, tiles, 1, value, slots, masks);
  }
  __syncthreads();
  unsigned any_wide = 0;
#pragma unroll
  for (int warp = 0; warp < kSumThreads / 32; ++warp) any_wide |= wide[warp];
  if (any_wide == 0) return;  // the same in the whole block
  for (int s = 0; s < kSumSplats; ++s) {
    if ((wide[s / 2] >> (s % 2 * 16) & 1u) == 0) continue;  // the same in the whole block
    parts[me] = sum_of_value(slot_offsets[first_splat + s] + mine, tile_counts[first_splat + s] - mine,
                             kSumParts, value, slots, masks);
    __syncthreads();
    if (mine == 0) {
      float sum = 0.0f;
      for (int part = 0; part < kSumParts; ++part) sum += parts[part * kGradStride + value];
      v_records[(first_splat + s) * kGradStride + value] = sum;
    }
    __syncthreads();
  }
}
