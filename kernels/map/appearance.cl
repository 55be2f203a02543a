// SPDX-License-Identifier: Apache-2.0
// These kernels map the colours of a rendered image to those of one photograph, and compute the gradients of this
// mapping (kernels/math/appearance.h). Planes are padded to whole tiles; values in the padding are undefined and do not
// enter any sum.

#define APPEARANCE_ROWS 16  // number of rows per partial sum; the number of rows of a plane is a multiple of it

typedef struct {
  real f[kAppearanceSize];
} AppearanceFactors;

UBS_FN AppearanceFactors appearance_factors(UBS_GLOBAL const real* numbers, uint first) {
  AppearanceFactors m;
  UBS_UNROLL for (int q = 0; q < kAppearanceSize; ++q) m.f[q] = appearance_factor(q, numbers[first + q]);
  return m;
}

UBS_KERNEL void map_colours(UBS_GLOBAL const real* image, uint plane, UBS_GLOBAL const real* numbers, uint first,
                            UBS_GLOBAL real* mapped) {
  uint at = UBS_GLOBAL_ID(0) * UBS_VW;
  if (at >= plane) return;
  AppearanceFactors m = appearance_factors(numbers, first);
  vreal r = UBS_LOAD(image + at), g = UBS_LOAD(image + plane + at), b = UBS_LOAD(image + 2 * (size_t)plane + at);
  UBS_STORE(m.f[0] * r + m.f[1] * g + m.f[2] * b + m.f[3], mapped + at);
  UBS_STORE(m.f[4] * r + m.f[5] * g + m.f[6] * b + m.f[7], mapped + plane + at);
  UBS_STORE(m.f[8] * r + m.f[9] * g + m.f[10] * b + m.f[11], mapped + 2 * (size_t)plane + at);
}

// Replaces v_image, the gradient of the mapped image, by the gradient of the unmapped image. Also writes to `sums` the
// partial sums for the gradient of the twelve numbers. Each number has a plane of (strips, pitch); an element of it is
// the sum over one column of a strip of APPEARANCE_ROWS rows.
UBS_KERNEL void map_colours_vjp(UBS_GLOBAL const real* image, int width, int height, int pitch, int rows,
                                UBS_GLOBAL const real* numbers, uint first, UBS_GLOBAL real* v_image,
                                UBS_GLOBAL real* sums) {
  int x = (int)(UBS_GLOBAL_ID(0) * UBS_VW), strip = (int)UBS_GLOBAL_ID(1);
  if (x >= pitch) return;
  AppearanceFactors m = appearance_factors(numbers, first);
  size_t plane = (size_t)pitch * rows;
  vmask columns = ubs_lane_indices((uint)x) < (vuint)((uint)width) ? (vmask)(-1) : (vmask)(0);
  vreal sum[kAppearanceSize];
  UBS_UNROLL for (int q = 0; q < kAppearanceSize; ++q) sum[q] = V(0.0);
  for (int row = 0; row < APPEARANCE_ROWS; ++row) {
    int y = strip * APPEARANCE_ROWS + row;
    if (y >= height) break;
    vreal c[4], v[3];
    UBS_UNROLL for (int k = 0; k < 3; ++k) {
      size_t at = k * plane + (size_t)y * pitch + x;
      v[k] = UBS_LOAD(v_image + at);
      c[k] = UBS_LOAD(image + at);
      c[k] = columns ? c[k] : V(0.0);
    }
    c[3] = V(1.0);
    UBS_UNROLL for (int q = 0; q < kAppearanceSize; ++q) sum[q] += v[q / 4] * c[q % 4];
    UBS_UNROLL for (int k = 0; k < 3; ++k)
      UBS_STORE(m.f[k] * v[0] + m.f[4 + k] * v[1] + m.f[8 + k] * v[2],
                v_image + k * plane + (size_t)y * pitch + x);
  }
  size_t strips = (size_t)(rows / APPEARANCE_ROWS);
  UBS_UNROLL for (int q = 0; q < kAppearanceSize; ++q)
    UBS_STORE(sum[q], sums + (q * strips + strip) * pitch + x);
}

// Computes the gradient of the twelve numbers, with one work-item per number. The kernel row_sums must run before this
// kernel. It replaces the first element of each row of `sums` by the sum of the row.
UBS_KERNEL void appearance_gradient(UBS_GLOBAL const real* sums, int pitch, int strips,
                                    UBS_GLOBAL const real* numbers, uint first, UBS_GLOBAL real* gradient,
                                    uint first_gradient) {
  int q = (int)UBS_GLOBAL_ID(0);
  if (q >= kAppearanceSize) return;
  real total = R(0.0);
  for (int s = 0; s < strips; ++s) total += sums[((size_t)q * strips + s) * pitch];
  gradient[first_gradient + q] = total * appearance_slope(q, numbers[first + q]);
}
