// SPDX-License-Identifier: Apache-2.0
// The functions of this file convert the lanes of a vmask to bits and find the lowest set bit. With PoCL they are one
// or two compiler built-ins. Otherwise the conversion is a tree of bitwise ORs.
#pragma once

// Returns the lanes as a bit mask. Bit i is set if lane i is true.
#if UBS_VW == 1
UBS_FN uint lane_bits(vmask m) { return m != 0; }
#elif UBS_VW == 16
UBS_FN uint lane_bits(vmask m) {
#if defined(UBS_POCL) && defined(__AVX512DQ__)
  return (ushort)__builtin_ia32_cvtd2mask512(m);
#else
  int16 b = m & (int16)(1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768);
  int8 c = b.lo | b.hi;
  int4 d = c.lo | c.hi;
  int2 e = d.lo | d.hi;
  return (uint)(e.x | e.y);
#endif
}
#elif UBS_VW == 8
UBS_FN uint lane_bits(vmask m) {
#if defined(UBS_POCL) && defined(__AVX__)
  return (uint)__builtin_ia32_movmskps256(as_float8(m));
#else
  int8 b = m & (int8)(1, 2, 4, 8, 16, 32, 64, 128);
  int4 c = b.lo | b.hi;
  int2 d = c.lo | c.hi;
  return (uint)(d.x | d.y);
#endif
}
#else
UBS_FN uint lane_bits(vmask m) {
  int4 b = m & (int4)(1, 2, 4, 8);
  int2 c = b.lo | b.hi;
  return (uint)(c.x | c.y);
}
#endif

// These functions return the index of the lowest set bit. `bits` must not be 0.
#ifdef UBS_POCL  // one instruction instead of four
UBS_FN int lowest_bit(ulong bits) { return __builtin_ctzl(bits); }
UBS_FN int lowest_bit32(uint bits) { return __builtin_ctz(bits); }
#else
UBS_FN int lowest_bit(ulong bits) { return 63 - (int)clz(bits & (0 - bits)); }
UBS_FN int lowest_bit32(uint bits) { return 31 - (int)clz(bits & (0 - bits)); }
#endif
