// SPDX-License-Identifier: Apache-2.0
// Gradient of a projected splat = sum of its slots, in slot order.

constexpr int kSumThreads = 256;  // a block

// 16 neighbouring threads a splat, so that a slot is one coalesced read. Slots of mask 0 were never written: they may
// hold anything, NaN included.
UBS_KERNEL void __launch_bounds__(kSumThreads)
    sum_slots(unsigned count, const unsigned* tile_counts, const unsigned* slot_offsets, const float* slots,
              const unsigned short* masks, float* v_records) {
  const size_t item = static_cast<size_t>(blockIdx.x) * blockDim.x + threadIdx.x;
  const size_t splat = item / UBS_GRAD_STRIDE;
  const unsigned value = static_cast<unsigned>(item % UBS_GRAD_STRIDE);
  if (splat >= count) return;
  float sum = 0.0f;
  const unsigned tiles = tile_counts[splat];
  const size_t first = tiles > 0 ? slot_offsets[splat] : 0;
  for (size_t slot = first; slot < first + tiles; ++slot)
    if (masks[slot] != 0) sum += load_slot_value(slots, slot, value);
  v_records[splat * UBS_GRAD_STRIDE + value] = sum;
}
