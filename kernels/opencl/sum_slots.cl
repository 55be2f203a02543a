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
#define UBS_SUM_ITEMS 1
#else
#define UBS_SUM_ITEMS UBS_SUM_GROUP
#endif

// CPU: one work-item a splat, a slot is one vector.
__kernel __attribute__((reqd_work_group_size(UBS_SUM_ITEMS, 1, 1))) void sum_slots_vector(
    uint count, __global const uint* tile_counts, __global const uint* slot_offsets,
    UBS_SLOTS(__global const float*), __global const ushort* masks, __global const float* records,
    __global float* v_records UBS_DEALT_PARAMETERS) {
  UBS_DEALT_ITEMS(splat) {
    if (splat >= count) return;
    uint first = slot_offsets[splat], last = first + tile_counts[splat];
    float16 gradient = (float16)(0.0f);
    if (last > first)  // else it is not drawn, and its record may be anything
      gradient =
          gradient_of_sums(sum_of_slots(first, last, UBS_SLOT_ARGUMENTS, masks), load_splat_record(records, splat));
    vstore16(gradient, splat, v_records);
  }
}

// GPU: slots are gradients already; 16 neighbouring work-items a splat, so that a slot is one coalesced read.
__kernel __attribute__((reqd_work_group_size(UBS_SUM_GROUP_GPU, 1, 1))) void sum_slots_scalar(
    uint count, __global const uint* tile_counts, __global const uint* slot_offsets,
    UBS_SLOTS(__global const float*), __global const ushort* masks, __global const float* records,
    __global float* v_records) {
  uint splat = (uint)(get_global_id(0) / UBS_GRAD_STRIDE);
  uint value = (uint)(get_global_id(0) % UBS_GRAD_STRIDE);
  if (splat >= count) return;
  float sum = 0.0f;
  uint first = slot_offsets[splat], last = first + tile_counts[splat];
  for (uint slot = first; slot < last; ++slot)
    if (masks[slot] != 0) sum += load_slot_value(UBS_SLOT_PIECE(slot), UBS_SLOT_IN_PIECE(slot), value);
  v_records[(ulong)splat * UBS_GRAD_STRIDE + value] = sum;
}
