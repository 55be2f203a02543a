// SPDX-License-Identifier: Apache-2.0
// Computes the gradient of each projected splat. It is the sum of the splat's slots, which contain one gradient for
// each tile that the splat reaches. The slots are added in their order. 16 consecutive work-items process one splat; 12
// of them read the 12 values of a slot, which is one coalesced read.
// A splat with more than kWideSplat slots would take as long as all other splats of the work-group together. Therefore
// the whole work-group adds the slots of such a splat in kSumParts parts. Part k consists of the slots k, k +
// kSumParts, k + 2 kSumParts and so on. Finally the sums of the parts are added in their order.

#ifndef UBS_SUM_GROUP_GPU
#define UBS_SUM_GROUP_GPU 64
#endif

enum {
  kWideSplat = 64,
  kSumParts = 16,
};

// Returns the sum of one value over the slots first, first + step, first + 2 step and so on, below first + count. Slots
// with mask 0 are skipped, because they were never written and may contain anything, including NaN.
UBS_FN float sum_of_value(uint first, uint count, uint step, uint value, UBS_SLOTS(UBS_GLOBAL const float*),
                          UBS_GLOBAL const ushort* masks) {
  float sum = 0.0f;
  if (value >= kCardSlotStride) return sum;
  for (uint k = 0; k < count; k += step) {
    uint slot = first + k;
    if (masks[slot] != 0) sum += UBS_SLOT_PIECE(slot)[(ulong)UBS_SLOT_IN_PIECE(slot) * kCardSlotStride + value];
  }
  return sum;
}

UBS_KERNEL UBS_GROUP(UBS_SUM_GROUP_GPU) void sum_slots_scalar(
    uint count, UBS_GLOBAL const uint* tile_counts, UBS_GLOBAL const uint* slot_offsets,
    UBS_SLOTS(UBS_GLOBAL const float*), UBS_GLOBAL const ushort* masks, UBS_GLOBAL float* v_records) {
  UBS_SHARED uint any_wide;
  UBS_SHARED float parts[kSumParts * kGradStride];
  const uint teams = UBS_SUM_GROUP_GPU / kGradStride;
  uint team = (uint)ubs_local_id() / kGradStride, value = (uint)ubs_local_id() % kGradStride;
  uint first_splat = ubs_group_id() * teams, mine = first_splat + team;
  uint tiles = mine < count ? tile_counts[mine] : 0;
  if (ubs_local_id() == 0) any_wide = 0;
  UBS_BARRIER();
  if (tiles > kWideSplat) {
    if (value == 0) ubs_atomic_or(&any_wide, 1u);
  } else if (mine < count) {
    v_records[(ulong)mine * kGradStride + value] =
        sum_of_value(tiles > 0 ? slot_offsets[mine] : 0, tiles, 1, value, UBS_SLOT_ARGUMENTS, masks);
  }
  UBS_BARRIER();
  if (any_wide == 0) return;
  uint end = count - first_splat < teams ? count : first_splat + teams;
  for (uint splat = first_splat; splat < end; ++splat) {
    if (tile_counts[splat] <= kWideSplat) continue;  // all work-items of the group take the same branch
    for (uint part = team; part < kSumParts; part += teams)
      parts[part * kGradStride + value] = sum_of_value(slot_offsets[splat] + part, tile_counts[splat] - part,
                                                       kSumParts, value, UBS_SLOT_ARGUMENTS, masks);
    UBS_BARRIER();
    if (team == 0) {
      float sum = 0.0f;
      for (int part = 0; part < kSumParts; ++part) sum += parts[part * kGradStride + value];
      v_records[(ulong)splat * kGradStride + value] = sum;
    }
    UBS_BARRIER();
  }
}
