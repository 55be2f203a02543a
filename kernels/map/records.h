// SPDX-License-Identifier: Apache-2.0
// Records of 16 reals a splat, read and written for UBS_VW consecutive splats at once: field k of all lanes is
// one vreal. At 16 lanes the two layouts are each other's transpose, done in registers by four rounds of
// interleaving; going through memory element by element stalls on store forwarding. One lane goes by words of four,
// which neighbouring lanes of a GPU have 64 bytes apart.

typedef struct {
  vreal field[16];
} Records;

#if UBS_VW == 16
UBS_FN float16 interleave_low(float16 a, float16 b) {
  return (float16)(a.s0, b.s0, a.s1, b.s1, a.s2, b.s2, a.s3, b.s3, a.s4, b.s4, a.s5, b.s5, a.s6, b.s6, a.s7, b.s7);
}
UBS_FN float16 interleave_high(float16 a, float16 b) {
  return (float16)(a.s8, b.s8, a.s9, b.s9, a.sa, b.sa, a.sb, b.sb, a.sc, b.sc, a.sd, b.sd, a.se, b.se, a.sf, b.sf);
}
UBS_FN Records transpose_records(Records r) {
  UBS_UNROLL for (int round = 0; round < 4; ++round) {
    Records next;
    UBS_UNROLL for (int i = 0; i < 8; ++i) {
      next.field[2 * i] = interleave_low(r.field[i], r.field[i + 8]);
      next.field[2 * i + 1] = interleave_high(r.field[i], r.field[i + 8]);
    }
    r = next;
  }
  return r;
}
#endif

UBS_FN Records load_records(UBS_GLOBAL const real* from) {
  Records r;
#if UBS_VW == 16
  UBS_UNROLL for (int lane = 0; lane < 16; ++lane) r.field[lane] = vload16(lane, from);
  r = transpose_records(r);
#elif UBS_VW == 1
  UBS_UNROLL for (int k = 0; k < 16; k += 4) {
    const real4 word = ((UBS_GLOBAL const real4*)from)[k / 4];
    r.field[k] = word.x;
    r.field[k + 1] = word.y;
    r.field[k + 2] = word.z;
    r.field[k + 3] = word.w;
  }
#else
  real lanes[UBS_VW];
  UBS_UNROLL for (int k = 0; k < 16; ++k) {
    UBS_UNROLL for (int lane = 0; lane < UBS_VW; ++lane) lanes[lane] = from[lane * 16 + k];
    r.field[k] = UBS_LOAD(lanes);
  }
#endif
  return r;
}

UBS_FN void store_records(Records r, UBS_GLOBAL real* to) {
#if UBS_VW == 16
  r = transpose_records(r);
  UBS_UNROLL for (int lane = 0; lane < 16; ++lane) vstore16(r.field[lane], lane, to);
#elif UBS_VW == 1
  UBS_UNROLL for (int k = 0; k < 16; k += 4) {
    real4 word;
    word.x = r.field[k];
    word.y = r.field[k + 1];
    word.z = r.field[k + 2];
    word.w = r.field[k + 3];
    ((UBS_GLOBAL real4*)to)[k / 4] = word;
  }
#else
  real lanes[UBS_VW];
  UBS_UNROLL for (int k = 0; k < 16; ++k) {
    UBS_STORE(r.field[k], lanes);
    UBS_UNROLL for (int lane = 0; lane < UBS_VW; ++lane) to[lane * 16 + k] = lanes[lane];
  }
#endif
}

// (a, b) of lane i to to[2 i], to[2 i + 1].
UBS_FN void store_pairs(vuint a, vuint b, UBS_GLOBAL uint* to) {
#if UBS_VW == 16
  vstore16(as_uint16(interleave_low(as_float16(a), as_float16(b))), 0, to);
  vstore16(as_uint16(interleave_high(as_float16(a), as_float16(b))), 1, to);
#else
  uint first[UBS_VW], second[UBS_VW];
  UBS_STORE(a, first);
  UBS_STORE(b, second);
  UBS_UNROLL for (int lane = 0; lane < UBS_VW; ++lane) {
    to[2 * lane] = first[lane];
    to[2 * lane + 1] = second[lane];
  }
#endif
}
