// SPDX-License-Identifier: Apache-2.0
// The functions of this file read and write the records of UBS_VW consecutive splats. In memory, each splat has a
// record of 16 reals. In registers, field k of all UBS_VW records is one vreal. With 16 lanes the two layouts are
// transposes of each other. The transposition is done in registers, because a transposition through memory, element by
// element, would stall on store forwarding. With one lane, records are accessed in words of four reals; neighbouring
// lanes of a GPU then access words that are 64 bytes apart.

typedef struct {
  vreal field[16];
} Records;

#if UBS_VW == 16
// Transposes the records. It first transposes within groups of four lanes (opencl/shuffles.h), and then moves whole
// groups of four.
UBS_FN Records transpose_records(Records r) {
  Records fours, out;  // fours[4 g + s] has the fields 4 g to 4 g + 3 of the splats s, s + 4, s + 8 and s + 12
  UBS_UNROLL for (int g = 0; g < 16; g += 4) {
    float16 low = unpack_low(r.field[g], r.field[g + 1]), low2 = unpack_low(r.field[g + 2], r.field[g + 3]);
    float16 high = unpack_high(r.field[g], r.field[g + 1]), high2 = unpack_high(r.field[g + 2], r.field[g + 3]);
    fours.field[g] = pairs_low(low, low2);
    fours.field[g + 1] = pairs_high(low, low2);
    fours.field[g + 2] = pairs_low(high, high2);
    fours.field[g + 3] = pairs_high(high, high2);
  }
  UBS_UNROLL for (int s = 0; s < 4; ++s) {
    float16 even = even_fours(fours.field[s], fours.field[4 + s]);
    float16 even2 = even_fours(fours.field[8 + s], fours.field[12 + s]);
    float16 odd = odd_fours(fours.field[s], fours.field[4 + s]);
    float16 odd2 = odd_fours(fours.field[8 + s], fours.field[12 + s]);
    out.field[s] = even_fours(even, even2);
    out.field[4 + s] = even_fours(odd, odd2);
    out.field[8 + s] = odd_fours(even, even2);
    out.field[12 + s] = odd_fours(odd, odd2);
  }
  return out;
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

// Writes the values a and b of lane i to to[2 i] and to[2 i + 1].
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
