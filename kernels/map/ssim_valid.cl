// SPDX-License-Identifier: Apache-2.0
// Computes 1 - SSIM for all windows that are completely inside the image (kernels/math/loss.h), one channel at a time.
// The window is separable: ssim_rows sums along rows into four planes, and ssim_columns sums these planes along
// columns. A plane has `pitch` columns, a multiple of 16; the values after column width - 11 are never used.
// The middle of the range, 0.5, is subtracted from all pixels, so that the rounding error of var = E[u^2] - E[u]^2 is
// at most 1e-7. This is small compared with the constant C2 = 9e-4 of the formula of SSIM.

// Computes the window sums of u, v, u^2 and v^2 along row y, with u = a + b - 1 and v = a - b.
UBS_KERNEL void ssim_rows(UBS_GLOBAL const real* a, UBS_GLOBAL const real* b, int first, int width, int height,
                          int pitch, UBS_GLOBAL real* sums) {
  const real weights[kSsimTaps] = UBS_SSIM_WEIGHTS;
  int x = (int)(UBS_GLOBAL_ID(0) * UBS_VW);
  int y = (int)UBS_GLOBAL_ID(1);
  if (x >= width - 2 * kSsimRadius) return;
  size_t from = (size_t)first + (size_t)y * width + x;
  vreal su = V(0.0), sv = V(0.0), suu = V(0.0), svv = V(0.0);
  UBS_UNROLL
  for (int k = 0; k < kSsimTaps; ++k) {
    vreal va = UBS_LOAD(a + from + k), vb = UBS_LOAD(b + from + k);
    vreal u = va + vb - V(1.0), v = va - vb;
    su += weights[k] * u;
    sv += weights[k] * v;
    suu += weights[k] * (u * u);
    svv += weights[k] * (v * v);
  }
  size_t plane = (size_t)pitch * height, to = (size_t)y * pitch + x;
  UBS_STORE(su, sums + to);
  UBS_STORE(sv, sums + to + plane);
  UBS_STORE(suu, sums + to + 2 * plane);
  UBS_STORE(svv, sums + to + 3 * plane);
}

// Computes 1 - SSIM of the windows that start in row y. The results are written to `sums`, starting at element
// `results`. They are height - 10 rows of `pitch` values. Values after the last window of a row are zero.
UBS_KERNEL void ssim_columns(UBS_GLOBAL real* sums, int width, int height, int pitch, int results) {
  const real weights[kSsimTaps] = UBS_SSIM_WEIGHTS;
  int x = (int)(UBS_GLOBAL_ID(0) * UBS_VW);
  int y = (int)UBS_GLOBAL_ID(1);
  if (x >= pitch) return;
  size_t plane = (size_t)pitch * height;
  SsimMeans m;
  m.u = V(0.0);
  m.v = V(0.0);
  m.uu = V(0.0);
  m.vv = V(0.0);
  UBS_UNROLL
  for (int k = 0; k < kSsimTaps; ++k) {
    size_t from = (size_t)(y + k) * pitch + x;
    m.u += weights[k] * UBS_LOAD(sums + from);
    m.v += weights[k] * UBS_LOAD(sums + from + plane);
    m.uu += weights[k] * UBS_LOAD(sums + from + 2 * plane);
    m.vv += weights[k] * UBS_LOAD(sums + from + 3 * plane);
  }
  SsimPoint p = ssim_point(m, R(0.5));
  vmask counts = ubs_lane_indices((uint)x) < (uint)(width - 2 * kSsimRadius) ? (vmask)(-1) : (vmask)(0);
  UBS_STORE(counts ? p.dissimilarity : V(0.0), sums + results + (size_t)y * pitch + x);
}
