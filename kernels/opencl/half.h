// SPDX-License-Identifier: Apache-2.0
// Projected splats and gradient slots as the rasterisers and the sum over slots read and write them: 16 floats, or
// 32 bytes with UBS_HALF_RECORDS (kernels/map/half_records.h) and UBS_HALF_GRADIENTS. A gradient keeps the upper 16
// bits of its floats (bfloat16), not a half: gradients of a mean over pixels are far below the smallest half.
#ifndef UBS_HALF_H
#define UBS_HALF_H

#ifdef UBS_HALF_RECORDS
#define UBS_RECORD_WORDS 8
// Fields in their usual places.
UBS_FN float16 load_splat_record(__global const float* records, uint splat) {
  __global const float* record = records + (ulong)splat * UBS_RECORD_WORDS;
#if defined(UBS_POCL) && defined(__F16C__)  // PoCL's vload_half goes through scalar integers
  float8 h = __builtin_ia32_vcvtph2ps256(as_short8(vload4(0, (__global const uint*)record + 3)));
#else
  float8 h = vload_half8(0, (__global const half*)(record + 3));
#endif
  return (float16)(record[0], record[1], h, 0.0f, 0.0f, record[2], 0.0f, 0.0f, 0.0f);
}
#else
#define UBS_RECORD_WORDS UBS_SPLAT_STRIDE
UBS_FN float16 load_splat_record(__global const float* records, uint splat) { return vload16(splat, records); }
#endif

#ifdef UBS_HALF_GRADIENTS
#define UBS_SLOT_WORDS 8
// To the nearest, ties to even.
UBS_FN void store_slot(float16 x, __global float* slot) {
  uint16 bits = as_uint16(x);
  bits += 0x7fff + ((bits >> 16) & 1);
  vstore16(convert_ushort16(bits >> 16), 0, (__global ushort*)slot);
}
// Values 4 part .. 4 part + 3.
UBS_FN void store_slot_part(float4 x, int part, __global float* slot) {
  uint4 bits = as_uint4(x);
  bits += 0x7fff + ((bits >> 16) & 1);
  ((__global ushort4*)slot)[part] = convert_ushort4(bits >> 16);
}
UBS_FN float16 load_slot(__global const float* slots, uint slot) {
  return as_float16(convert_uint16(vload16(slot, (__global const ushort*)slots)) << 16);
}
UBS_FN float load_slot_value(__global const float* slots, uint slot, uint value) {
  return as_float((uint)((__global const ushort*)slots)[(ulong)slot * UBS_GRAD_STRIDE + value] << 16);
}
#else
#define UBS_SLOT_WORDS UBS_GRAD_STRIDE
UBS_FN void store_slot(float16 x, __global float* slot) { vstore16(x, 0, slot); }
UBS_FN void store_slot_part(float4 x, int part, __global float* slot) { ((__global float4*)slot)[part] = x; }
UBS_FN float16 load_slot(__global const float* slots, uint slot) { return vload16(slot, slots); }
UBS_FN float load_slot_value(__global const float* slots, uint slot, uint value) {
  return slots[(ulong)slot * UBS_GRAD_STRIDE + value];
}
#endif

#endif
