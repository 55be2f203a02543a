// SPDX-License-Identifier: Apache-2.0
// With UBS_GAUSSIAN_ARRAYS, the functions of this file replace the accesses to rows of parameters. They read 3D
// Gaussians from arrays of the program, and write gradients to such arrays. In these arrays, all values of a Gaussian
// are adjacent, while a vreal holds one value of UBS_VW Gaussians. So the functions transpose. No lane accesses memory
// beyond the last Gaussian, because the arrays are not padded: when values are loaded, additional lanes get those of
// the last Gaussian.
#if UBS_GAUSSIAN_ARRAYS

// GaussianArrays contains the addresses of arrays: means (count, 3), quats (count, 4) with w first, scales (count, 3),
// opacities (count) and colours (count, bases, 3). The colours are coefficients of spherical harmonics; `bases` is at
// least UBS_SH_COUNT, and further bases are not used. Without harmonics, `bases` is 1. The host has a struct with the
// same name and layout (host/device/stages.hpp).
typedef struct {
  UBS_GLOBAL real *means, *quats, *scales, *opacities, *colours;
  uint bases, unused;
} GaussianArrays;

enum { kColours = UBS_COLOUR ? 3 * UBS_SH_COUNT : 3 };  // number of used values of `colours` per Gaussian

// Returns the first `words` of `stride` values of the Gaussians `first` to first + UBS_VW - 1. Field k of the result
// contains value k. `words` is a constant, at most 16.
UBS_FN Records load_values(UBS_GLOBAL const real* from, uint stride, uint first, uint count, int words) {
  Records r;
#if UBS_VW == 16
  if (words == 16) {
    UBS_UNROLL for (int lane = 0; lane < 16; ++lane) {
      uint splat = first + lane < count ? first + lane : count - 1;
      r.field[lane] = vload16(0, from + (size_t)splat * stride);
    }
    return transpose_records(r);
  }
#endif
  real lanes[UBS_VW];
  UBS_UNROLL for (int k = 0; k < 16; ++k)
    if (k < words) {
      UBS_UNROLL for (int lane = 0; lane < UBS_VW; ++lane) {
        uint splat = first + lane < count ? first + lane : count - 1;
        lanes[lane] = from[(size_t)splat * stride + k];
      }
      r.field[k] = UBS_LOAD(lanes);
    }
  return r;
}

// Writes what load_values() reads.
UBS_FN void store_values(Records r, UBS_GLOBAL real* to, uint stride, uint first, uint count, int words) {
#if UBS_VW == 16
  if (words == 16) {
    r = transpose_records(r);
    UBS_UNROLL for (int lane = 0; lane < 16; ++lane)
      if (first + lane < count) vstore16(r.field[lane], 0, to + (size_t)(first + lane) * stride);
    return;
  }
#endif
  real lanes[UBS_VW];
  UBS_UNROLL for (int k = 0; k < 16; ++k)
    if (k < words) {
      UBS_STORE(r.field[k], lanes);
      UBS_UNROLL for (int lane = 0; lane < UBS_VW; ++lane)
        if (first + lane < count) to[(size_t)(first + lane) * stride + k] = lanes[lane];
    }
}

// Returns the row of value i of the colours of a Gaussian.
UBS_FN int colour_row(int i) { return UBS_COLOUR ? sh_row(i % 3, i / 3) : kRowRgb + i; }

UBS_FN SplatRaw load_gaussians(GaussianArrays from, uint first, uint count) {
  SplatRaw raw;
  Records means = load_values(from.means, 3, first, count, 3);
  Records quats = load_values(from.quats, 4, first, count, 4);
  Records scales = load_values(from.scales, 3, first, count, 3);
  UBS_UNROLL for (int k = 0; k < 3; ++k) raw.e[kRowXyz + k] = means.field[k];
  UBS_UNROLL for (int k = 0; k < 4; ++k) raw.e[kRowL + k] = quats.field[k];
  UBS_UNROLL for (int k = 0; k < 3; ++k) raw.e[kRowScale + k] = scales.field[k];
  raw.e[kRowOpacity] = load_values(from.opacities, 1, first, count, 1).field[0];
  UBS_UNROLL for (int part = 0; part < kColours; part += 16) {
    int words = kColours - part < 16 ? kColours - part : 16;
    Records colours = load_values(from.colours + part, 3 * from.bases, first, count, words);
    UBS_UNROLL for (int k = 0; k < 16; ++k)
      if (k < words) raw.e[colour_row(part + k)] = colours.field[k];
  }
  return raw;
}

// Writes the gradients of the Gaussians `first` to first + UBS_VW - 1.
UBS_FN void store_gaussians(SplatRaw gradient, GaussianArrays to, uint first, uint count) {
  Records out;
  UBS_UNROLL for (int k = 0; k < 16; ++k) out.field[k] = V(0.0);
  UBS_UNROLL for (int k = 0; k < 3; ++k) out.field[k] = gradient.e[kRowXyz + k];
  store_values(out, to.means, 3, first, count, 3);
  UBS_UNROLL for (int k = 0; k < 4; ++k) out.field[k] = gradient.e[kRowL + k];
  store_values(out, to.quats, 4, first, count, 4);
  UBS_UNROLL for (int k = 0; k < 3; ++k) out.field[k] = gradient.e[kRowScale + k];
  store_values(out, to.scales, 3, first, count, 3);
  out.field[0] = gradient.e[kRowOpacity];
  store_values(out, to.opacities, 1, first, count, 1);
  UBS_UNROLL for (int part = 0; part < kColours; part += 16) {
    int words = kColours - part < 16 ? kColours - part : 16;
    UBS_UNROLL for (int k = 0; k < 16; ++k)
      if (k < words) out.field[k] = gradient.e[colour_row(part + k)];
    store_values(out, to.colours + part, 3 * to.bases, first, count, words);
  }
}

#endif
