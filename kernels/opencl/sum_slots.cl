// SPDX-License-Identifier: Apache-2.0
// Gradient of a projected splat = sum of its slots, one slot a tile that it reaches, in slot order. Slots
// of mask 0 were never written: they may hold anything, NaN included.

#ifndef UBS_SUM_GROUP
#define UBS_SUM_GROUP 64
#endif
#ifndef UBS_SUM_GROUP_GPU
#define UBS_SUM_GROUP_GPU 64
#endif

#ifdef UBS_CORES
enum { kSumItems = 1 };
#else
enum { kSumItems = UBS_SUM_GROUP };
#endif

// CPU: one work-item a splat, a slot is one vector.
__kernel __attribute__((reqd_work_group_size(kSumItems, 1, 1))) void sum_slots_vector(
    uint count, __global const uint* tile_counts, __global const uint* slot_offsets,
    UBS_SLOTS(__global const float*), __global const ushort* masks, __global const float* records,
    __global float* v_records UBS_CORE_PARAMETERS) {
  uint splat = UBS_CORE_FIRST_ITEM;
  UBS_CORE_ITEMS(splat) {
    if (splat >= count) return;
    uint first = slot_offsets[splat], last = first + tile_counts[splat];
    float16 gradient = (float16)(0.0f);
    if (last > first)  // else it is not drawn, and its record may be anything
      gradient =
          gradient_of_sums(sum_of_slots(first, last, UBS_SLOT_ARGUMENTS, masks), vload16(splat, records));
    vstore16(gradient, splat, v_records);
  }
}

// GPU: slots are gradients already; 16 neighbouring work-items a splat, so that a slot is one coalesced read.
// A splat of many slots (map/slot_value.h) is the whole group's.
__kernel __attribute__((reqd_work_group_size(UBS_SUM_GROUP_GPU, 1, 1))) void sum_slots_scalar(
    uint count, __global const uint* tile_counts, __global const uint* slot_offsets,
    UBS_SLOTS(__global const float*), __global const ushort* masks, __global float* v_records) {
  __local uint any_wide;
  __local float parts[kSumParts * kGradStride];
  const uint teams = UBS_SUM_GROUP_GPU / kGradStride;
  uint team = (uint)get_local_id(0) / kGradStride, value = (uint)get_local_id(0) % kGradStride;
  uint first_splat = (uint)get_group_id(0) * teams, mine = first_splat + team;
  uint tiles = mine < count ? tile_counts[mine] : 0;
  if (get_local_id(0) == 0) any_wide = 0;
  barrier(CLK_LOCAL_MEM_FENCE);
  if (tiles > kWideSplat) {
    any_wide = 1;  // whoever writes it
  } else if (mine < count) {
    v_records[(ulong)mine * kGradStride + value] =
        sum_of_value(slot_offsets[mine], tiles, 1, value, UBS_SLOT_ARGUMENTS, masks);
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  if (!any_wide) return;
  for (uint splat = first_splat; splat < min(count, first_splat + teams); ++splat) {
    if (tile_counts[splat] <= kWideSplat) continue;  // the same for the whole group
    for (uint part = team; part < kSumParts; part += teams)
      parts[part * kGradStride + value] = sum_of_value(slot_offsets[splat] + part, tile_counts[splat] - part,
                                                       kSumParts, value, UBS_SLOT_ARGUMENTS, masks);
    barrier(CLK_LOCAL_MEM_FENCE);
    if (team == 0) {
      float sum = 0.0f;
      for (int part = 0; part < kSumParts; ++part) sum += parts[part * kGradStride + value];
      v_records[(ulong)splat * kGradStride + value] = sum;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
  }
}
