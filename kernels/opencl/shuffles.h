// SPDX-License-Identifier: Apache-2.0
// The functions of this file rearrange the lanes of two vectors a and b. The first four work within each group of four
// lanes and return:
// - unpack_low: a0 b0 a1 b1; unpack_high: a2 b2 a3 b3
// - pairs_low: a0 a1 b0 b1; pairs_high: a2 a3 b2 b3
// They list every lane separately, because then they compile to the CPU's unpack instructions, which take one cycle.
// Swizzles of several lanes do not compile to these instructions, and make the backward rasteriser 12 % slower. The
// other functions, which exist only for 16 lanes, rearrange lanes across the whole vector, which takes three cycles.
#pragma once

#if UBS_VW == 16
UBS_FN float16 unpack_low(float16 a, float16 b) {
  return (float16)(a.s0, b.s0, a.s1, b.s1, a.s4, b.s4, a.s5, b.s5, a.s8, b.s8, a.s9, b.s9, a.sc, b.sc, a.sd, b.sd);
}
UBS_FN float16 unpack_high(float16 a, float16 b) {
  return (float16)(a.s2, b.s2, a.s3, b.s3, a.s6, b.s6, a.s7, b.s7, a.sa, b.sa, a.sb, b.sb, a.se, b.se, a.sf, b.sf);
}
UBS_FN float16 pairs_low(float16 a, float16 b) {
  return (float16)(a.s0, a.s1, b.s0, b.s1, a.s4, a.s5, b.s4, b.s5, a.s8, a.s9, b.s8, b.s9, a.sc, a.sd, b.sc, b.sd);
}
UBS_FN float16 pairs_high(float16 a, float16 b) {
  return (float16)(a.s2, a.s3, b.s2, b.s3, a.s6, a.s7, b.s6, b.s7, a.sa, a.sb, b.sa, b.sb, a.se, a.sf, b.se, b.sf);
}
// These functions interleave the lanes of two vectors across their whole length.
UBS_FN float16 interleave_low(float16 a, float16 b) {
  return (float16)(a.s0, b.s0, a.s1, b.s1, a.s2, b.s2, a.s3, b.s3, a.s4, b.s4, a.s5, b.s5, a.s6, b.s6, a.s7, b.s7);
}
UBS_FN float16 interleave_high(float16 a, float16 b) {
  return (float16)(a.s8, b.s8, a.s9, b.s9, a.sa, b.sa, a.sb, b.sb, a.sc, b.sc, a.sd, b.sd, a.se, b.se, a.sf, b.sf);
}
// These functions return the groups of four lanes with even numbers, or those with odd numbers, of both vectors.
UBS_FN float16 even_fours(float16 a, float16 b) {
  return (float16)(a.s0, a.s1, a.s2, a.s3, a.s8, a.s9, a.sa, a.sb, b.s0, b.s1, b.s2, b.s3, b.s8, b.s9, b.sa, b.sb);
}
UBS_FN float16 odd_fours(float16 a, float16 b) {
  return (float16)(a.s4, a.s5, a.s6, a.s7, a.sc, a.sd, a.se, a.sf, b.s4, b.s5, b.s6, b.s7, b.sc, b.sd, b.se, b.sf);
}
#elif UBS_VW == 8
UBS_FN float8 unpack_low(float8 a, float8 b) {
  return (float8)(a.s0, b.s0, a.s1, b.s1, a.s4, b.s4, a.s5, b.s5);
}
UBS_FN float8 unpack_high(float8 a, float8 b) {
  return (float8)(a.s2, b.s2, a.s3, b.s3, a.s6, b.s6, a.s7, b.s7);
}
UBS_FN float8 pairs_low(float8 a, float8 b) {
  return (float8)(a.s0, a.s1, b.s0, b.s1, a.s4, a.s5, b.s4, b.s5);
}
UBS_FN float8 pairs_high(float8 a, float8 b) {
  return (float8)(a.s2, a.s3, b.s2, b.s3, a.s6, a.s7, b.s6, b.s7);
}
#elif UBS_VW == 4
UBS_FN float4 unpack_low(float4 a, float4 b) { return (float4)(a.s0, b.s0, a.s1, b.s1); }
UBS_FN float4 unpack_high(float4 a, float4 b) { return (float4)(a.s2, b.s2, a.s3, b.s3); }
UBS_FN float4 pairs_low(float4 a, float4 b) { return (float4)(a.s0, a.s1, b.s0, b.s1); }
UBS_FN float4 pairs_high(float4 a, float4 b) { return (float4)(a.s2, a.s3, b.s2, b.s3); }
#endif
