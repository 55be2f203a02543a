// SPDX-License-Identifier: Apache-2.0
// Computes the gradient of each projected splat on CPUs. A splat has one slot for each tile that it reaches, in which
// raster_cpu.cl has stored sums over pixels. The slots are added in their order, and the result is multiplied by the
// factors of blend_factors(), which are the same in every tile. Slots with mask 0 were never written and may contain
// anything, including NaN. They are read as well, but their values are replaced by zero with a bitwise AND. A branch
// that skips them would often be mispredicted, and would leave gaps in the stream of reads: if half of the slots are
// unwritten, it is 1.4 times slower.

UBS_FN float16 sum_of_slots(uint first, uint last, UBS_SLOTS(__global const float*), __global const ushort* masks) {
  float16 sum = (float16)(0.0f);
  for (uint slot = first; slot < last; ++slot)
    sum += as_float16(as_int16(vload16(UBS_SLOT_IN_PIECE(slot), UBS_SLOT_PIECE(slot))) &
                      (int16)(masks[slot] != 0 ? -1 : 0));
  return sum;
}

// Returns the gradient (kGrad*) of a splat from its sums and its record.
UBS_FN float16 gradient_of_sums(float16 sums, float16 record) {
  const float* field = (const float*)&record;
  BlendSplat s;
  s.l00 = field[kSplatL00];
  s.l01 = field[kSplatL01];
  s.l11 = field[kSplatL11];
  s.beta = field[kSplatBeta];
  s.opacity = s.r = s.g = s.b = 0.0f;  // not needed
  BlendFactors f = blend_factors(s);
  float8 factors = (float8)(f.xp, f.yq, f.square, f.square, f.square, 1.0f, UBS_LN2, 1.0f);
  float8 across = (float8)(0.0f, f.yp, 0.0f, 0.0f, (float4)(0.0f));
  return (float16)(sums.lo * factors + sums.lo.s10325476 * across, sums.s89, (float2)(0.0f), (float4)(0.0f));
}

#ifndef UBS_SUM_GROUP
#define UBS_SUM_GROUP 64
#endif

#ifdef UBS_CORES
enum { kSumItems = 1 };
#else
enum { kSumItems = UBS_SUM_GROUP };
#endif

// One work-item processes one splat. A slot is one vector.
__kernel __attribute__((reqd_work_group_size(kSumItems, 1, 1))) void sum_slots_vector(
    uint count, __global const uint* tile_counts, __global const uint* slot_offsets,
    UBS_SLOTS(__global const float*), __global const ushort* masks, __global const float* records,
    __global float* v_records UBS_CORE_PARAMETERS) {
  uint splat = UBS_CORE_FIRST_ITEM;
  UBS_CORE_ITEMS(splat) {
    if (splat >= count) return;
    uint first = slot_offsets[splat], last = first + tile_counts[splat];
    float16 gradient = (float16)(0.0f);
    if (last > first)  // otherwise the splat is not visible, and its record may contain anything
      gradient =
          gradient_of_sums(sum_of_slots(first, last, UBS_SLOT_ARGUMENTS, masks), vload16(splat, records));
    vstore16(gradient, splat, v_records);
  }
}
