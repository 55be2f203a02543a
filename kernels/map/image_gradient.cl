// SPDX-License-Identifier: Apache-2.0
// These kernels convert gradients with respect to alpha and depth into gradients with respect to colours, which the
// backward rasteriser computes with. host/pipeline/image_gradient.hpp explains the method. A work-item processes one
// pixel or one splat. The kernel row_sums (map/row_sums.cl) runs after depth_columns.

#define FAINTEST_ALPHA R(1e-6)  // minimum alpha of pixels whose depth has a gradient
#define LEAST_SHARE R(9.3132257e-10)  // minimum of |v_rgb| relative to |v_alpha|, 2^-30
#define LEAST_V R(1e-35)  // minimum of |v_rgb|, so that quotients are finite if |v_alpha| is tiny

// Changes one channel of the image so that the gradient of the colours includes the gradient of alpha.
UBS_KERNEL void alpha_to_colours(int width, int pitch, int rows, UBS_GLOBAL const real* v_alpha,
                                 UBS_GLOBAL const real* transmittance, UBS_GLOBAL real* image,
                                 UBS_GLOBAL real* v_image) {
  int x = (int)UBS_GLOBAL_ID(0);
  if (x >= width) return;
  size_t plane = (size_t)pitch * rows, at = (size_t)UBS_GLOBAL_ID(1) * pitch + x;
  real v = v_alpha[at];
  if (v == R(0.0)) return;
  size_t most = at;
  for (int c = 1; c < 3; ++c)
    if (ubs_fabs(v_image[c * plane + at]) > ubs_fabs(v_image[most])) most = c * plane + at;
  real least = ubs_max(LEAST_SHARE * ubs_fabs(v), LEAST_V);
  if (ubs_fabs(v_image[most]) < least) v_image[most] = least;
  image[most] -= v * transmittance[at] / v_image[most];
}

// Writes two values for each column of the image: sums[x] is the sum of the depths of those pixels whose depth has a
// gradient, and sums[pitch + x] is the number of these pixels.
UBS_KERNEL void depth_columns(int width, int height, int pitch, UBS_GLOBAL const real* depth,
                              UBS_GLOBAL const real* v_depth, UBS_GLOBAL real* sums) {
  int x = (int)UBS_GLOBAL_ID(0);
  if (x >= pitch) return;
  real sum = R(0.0), count = R(0.0);
  for (int y = 0; y < height && x < width; ++y) {
    size_t at = (size_t)y * pitch + x;
    if (v_depth[at] == R(0.0) || depth[at] == R(0.0)) continue;
    sum += depth[at];
    count += R(1.0);
  }
  sums[x] = sum;
  sums[pitch + x] = count;
}

// Returns z0, the mean depth.
UBS_FN real mean_depth(UBS_GLOBAL const real* sums, int pitch) {
  return sums[pitch] > R(0.0) ? sums[0] / sums[pitch] : R(0.0);
}

// Replaces the colours of the projected splats by z - z0, 1 and 0, where z is the depth of the splat.
UBS_KERNEL void depth_to_records(uint count, UBS_GLOBAL const real* sums, int pitch, UBS_GLOBAL real* records) {
  uint i = UBS_GLOBAL_ID(0);
  if (i >= count) return;
  UBS_GLOBAL real* record = records + (size_t)i * kSplatStride;
  record[kSplatR] = record[kSplatDepth] - mean_depth(sums, pitch);
  record[kSplatG] = R(1.0);
  record[kSplatB] = R(0.0);
}

// Replaces the image, and its gradient, by those of the pass for depth. Before, the image must have been rendered from
// the result of depth_to_records, so that its green channel is W, the sum of the weights of the splats. The kernel does
// not use 1 - transmittance instead, because the rounding errors of this difference are too large for pixels with a
// small alpha, and these pixels have a depth too.
UBS_KERNEL void depth_to_image(int width, int height, int pitch, int rows, UBS_GLOBAL const real* sums,
                               UBS_GLOBAL const real* depth, UBS_GLOBAL const real* v_depth, UBS_GLOBAL real* image,
                               UBS_GLOBAL real* v_image) {
  int x = (int)UBS_GLOBAL_ID(0), y = (int)UBS_GLOBAL_ID(1);
  if (x >= pitch) return;
  size_t plane = (size_t)pitch * rows, at = (size_t)y * pitch + x;
  real value = R(0.0), v = R(0.0);
  if (x < width && y < height && image[plane + at] > FAINTEST_ALPHA) {
    value = depth[at] - mean_depth(sums, pitch);
    v = v_depth[at] / image[plane + at];
  }
  image[at] = value;
  v_image[at] = v;
  image[plane + at] = image[2 * plane + at] = v_image[plane + at] = v_image[2 * plane + at] = R(0.0);
}

// Moves the gradient of the red channel, which the pass for depth has computed, to the depth of each projected splat.
// Then adds `earlier`, the gradient that comes from colours and alpha, unless it is null.
UBS_KERNEL void depth_from_records(uint count, UBS_GLOBAL const real* earlier, UBS_GLOBAL real* v_records) {
  uint i = UBS_GLOBAL_ID(0);
  if (i >= count) return;
  UBS_GLOBAL real* v = v_records + (size_t)i * kGradStride;
  v[kGradDepth] = v[kGradR];
  v[kGradR] = v[kGradG] = v[kGradB] = R(0.0);
  if (!earlier) return;
  for (int k = 0; k < kGradDepth; ++k) v[k] += earlier[(size_t)i * kGradStride + k];
}
