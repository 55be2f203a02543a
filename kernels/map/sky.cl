// SPDX-License-Identifier: Apache-2.0
// These kernels add a learnt sky behind the splats and compute the gradient of the sky (method.md 4.11). In the
// direction d of a pixel the sky has the colour
//   B(d) = s_0 + sum_{k = 1 ... 8} Y_k(d) s_k
// with the spherical harmonics Y_k of math/colour.h (UBS_SH_COUNT must be 9). transmittance * B is added to the pixel.
// Element 3 k + c of `sky` is channel c of s_k. Planes are padded to whole tiles; values in the padding are undefined
// and do not enter any sum.

#define SKY_ROWS 16  // number of rows per partial sum; the number of rows of a plane is a multiple of it

// Returns the factors of s_0 to s_8 in B(d) for UBS_VW pixels of row y, starting at column x.
UBS_FN ShBasis sky_basis(UBS_GLOBAL const real* camera, int x, int y) {
  UBS_GLOBAL const real* turn = camera + kCameraRotation;
  vreal px = UBS_TO_VREAL(ubs_lane_indices((uint)x)) + V(0.5);
  vreal u = (px - camera[kCameraPrincipal]) / camera[kCameraFocal];
  real v = ((real)y + R(0.5) - camera[kCameraPrincipal + 1]) / camera[kCameraFocal + 1];
  Vec3 d;
  UBS_UNROLL for (int k = 0; k < 3; ++k) d.e[k] = turn[k] * u + (turn[3 + k] * v + turn[6 + k]);
  vreal length = ubs_sqrt(d.e[0] * d.e[0] + d.e[1] * d.e[1] + d.e[2] * d.e[2]);
  UBS_UNROLL for (int k = 0; k < 3; ++k) d.e[k] = d.e[k] / length;
  ShBasis basis = sh_basis(d);
  basis.e[0] = V(1.0);
  return basis;
}

UBS_KERNEL void draw_sky(UBS_GLOBAL const real* cameras, uint camera, UBS_GLOBAL const real* sky, int pitch, int rows,
                         UBS_GLOBAL const real* transmittance, UBS_GLOBAL real* image) {
  int x = (int)(UBS_GLOBAL_ID(0) * UBS_VW), y = (int)UBS_GLOBAL_ID(1);
  if (x >= pitch) return;
  size_t plane = (size_t)pitch * rows, at = (size_t)y * pitch + x;
  ShBasis basis = sky_basis(cameras + (size_t)camera * kCameraStride, x, y);
  vreal left = UBS_LOAD(transmittance + at);
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    vreal colour = V(0.0);
    UBS_UNROLL for (int k = 0; k < UBS_SH_COUNT; ++k) colour += sky[3 * k + c] * basis.e[k];
    UBS_STORE(UBS_LOAD(image + c * plane + at) + left * colour, image + c * plane + at);
  }
}

// Writes to `sums` the partial sums for the gradient of the sky. Each of its 27 numbers has a plane of (strips, pitch);
// an element of the plane is the sum over one column of a strip of SKY_ROWS rows.
UBS_KERNEL void sky_vjp(UBS_GLOBAL const real* cameras, uint camera, int width, int height, int pitch, int rows,
                        UBS_GLOBAL const real* transmittance, UBS_GLOBAL const real* v_image, UBS_GLOBAL real* sums) {
  int x = (int)(UBS_GLOBAL_ID(0) * UBS_VW), strip = (int)UBS_GLOBAL_ID(1);
  if (x >= pitch) return;
  size_t plane = (size_t)pitch * rows;
  vmask columns = ubs_lane_indices((uint)x) < (vuint)((uint)width) ? (vmask)(-1) : (vmask)(0);
  vreal sum[SKY_NUMBERS];
  UBS_UNROLL for (int q = 0; q < SKY_NUMBERS; ++q) sum[q] = V(0.0);
  for (int row = 0; row < SKY_ROWS; ++row) {
    int y = strip * SKY_ROWS + row;
    if (y >= height) break;
    size_t at = (size_t)y * pitch + x;
    ShBasis basis = sky_basis(cameras + (size_t)camera * kCameraStride, x, y);
    vreal left = UBS_LOAD(transmittance + at);
    left = columns ? left : V(0.0);
    UBS_UNROLL for (int c = 0; c < 3; ++c) {
      vreal v = left * UBS_LOAD(v_image + c * plane + at);
      UBS_UNROLL for (int k = 0; k < UBS_SH_COUNT; ++k) sum[3 * k + c] += v * basis.e[k];
    }
  }
  size_t strips = (size_t)(rows / SKY_ROWS);
  UBS_UNROLL for (int q = 0; q < SKY_NUMBERS; ++q) UBS_STORE(sum[q], sums + (q * strips + strip) * pitch + x);
}

// Computes the gradient of the sky, with one work-item per number. The kernel row_sums must run before this kernel. It
// replaces the first element of each row of `sums` by the sum of the row.
UBS_KERNEL void sky_gradient(UBS_GLOBAL const real* sums, int pitch, int strips, UBS_GLOBAL real* gradient,
                             uint first) {
  int q = (int)UBS_GLOBAL_ID(0);
  if (q >= SKY_NUMBERS) return;
  real total = R(0.0);
  for (int s = 0; s < strips; ++s) total += sums[((size_t)q * strips + s) * pitch];
  gradient[first + q] = total;
}
