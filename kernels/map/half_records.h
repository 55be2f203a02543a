// SPDX-License-Identifier: Apache-2.0
// Projected splats in 32 bytes: x, y and depth as floats (a half knows positions of 500 px to a quarter of a pixel),
// then the factor of the conic, opacity, beta and colour as halves; half extents are left out. Values beyond the
// largest half are stored as that.

#define UBS_HALF_MAX R(65504.0)
#define UBS_HALF_RECORD_WORDS 8

#ifndef UBS_OPENCL
#define as_float(bits) __uint_as_float(bits)
UBS_FN vuint half_bits(vreal x) { return half_from_float(ubs_min(ubs_max(x, -UBS_HALF_MAX), UBS_HALF_MAX)); }
#elif UBS_VW == 1
UBS_FN vuint half_bits(vreal x) {
  ushort bits;
  vstore_half(clamp(x, -UBS_HALF_MAX, UBS_HALF_MAX), 0, (half*)&bits);
  return bits;
}
#else
UBS_FN vuint half_bits(vreal x) {
  x = clamp(x, -UBS_HALF_MAX, UBS_HALF_MAX);
#if defined(UBS_POCL) && UBS_VW == 16 && defined(__AVX512F__)  // PoCL's vstore_half goes through scalar integers
  return convert_uint16(as_ushort16(__builtin_ia32_vcvtps2ph512_mask(x, 0, (short16)(0), (ushort)-1)));
#else
  ushort bits[UBS_VW];
  UBS_PASTE(vstore_half, UBS_VW)(x, 0, (half*)bits);
  return UBS_PASTE(convert_uint, UBS_VW)(UBS_LOAD(bits));
#endif
}
#endif

UBS_FN vuint half_pair(vreal low, vreal high) { return half_bits(low) | (half_bits(high) << 16); }

UBS_FN void store_half_records(Records r, UBS_GLOBAL real* to) {
  vuint packed[4];
  packed[0] = half_pair(r.field[UBS_S_L00], r.field[UBS_S_L01]);
  packed[1] = half_pair(r.field[UBS_S_L11], r.field[UBS_S_OPACITY]);
  packed[2] = half_pair(r.field[UBS_S_BETA], r.field[UBS_S_R]);
  packed[3] = half_pair(r.field[UBS_S_G], r.field[UBS_S_B]);
  Records out;
  UBS_UNROLL for (int k = 0; k < 16; ++k) out.field[k] = V(0.0);
  out.field[0] = r.field[UBS_S_X];
  out.field[1] = r.field[UBS_S_Y];
  out.field[2] = r.field[UBS_S_DEPTH];
#if UBS_VW == 1
  UBS_UNROLL for (int k = 0; k < 4; ++k) out.field[3 + k] = as_float(packed[k]);
  store_words(out, UBS_HALF_RECORD_WORDS, to);
#else
  UBS_UNROLL for (int k = 0; k < 4; ++k) out.field[3 + k] = UBS_PASTE(as_float, UBS_VW)(packed[k]);
#if UBS_VW == 16
  out = transpose_records(out);
  UBS_UNROLL for (int lane = 0; lane < 16; ++lane) vstore8(out.field[lane].lo, lane, to);
#else
  real lanes[UBS_VW];
  UBS_UNROLL for (int k = 0; k < UBS_HALF_RECORD_WORDS; ++k) {
    UBS_STORE(out.field[k], lanes);
    UBS_UNROLL for (int lane = 0; lane < UBS_VW; ++lane) to[lane * UBS_HALF_RECORD_WORDS + k] = lanes[lane];
  }
#endif
#endif
}
