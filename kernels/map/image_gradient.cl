// SPDX-License-Identifier: Apache-2.0
// These kernels convert gradients with respect to alpha and depth into gradients with respect to colours, which the
// backward rasteriser computes with. host/pipeline/image_gradient.hpp explains the method. A work-item processes one
// element of a plane, or one splat, except in the kernels that compute the mean depth. Planes have `rows` rows of
// `pitch` elements.

// Changes one channel of the image so that the gradient of the colours includes the gradient of alpha.
UBS_KERNEL void alpha_to_colours(int width, int height, int pitch, int rows, UBS_GLOBAL const real* v_alpha,
                                 UBS_GLOBAL const real* transmittance, UBS_GLOBAL real* image,
                                 UBS_GLOBAL real* v_image) {
  uint at = UBS_GLOBAL_ID(0);
  size_t plane = (size_t)pitch * rows;
  if (at >= plane || at % pitch >= (uint)width || at / pitch >= (uint)height) return;
  real v = v_alpha[at];
  if (v == R(0.0)) return;
  size_t most = at;
  for (int c = 1; c < 3; ++c)
    if (ubs_fabs(v_image[c * plane + at]) > ubs_fabs(v_image[most])) most = c * plane + at;
  real least = ubs_max(UBS_ALPHA_GRADIENT_SHARE * ubs_fabs(v), UBS_ALPHA_GRADIENT_MIN);
  if (ubs_fabs(v_image[most]) < least) v_image[most] = least;
  image[most] -= v * transmittance[at] / v_image[most];
}

// Divides the image into strips of kTileSide rows, and adds the pixels of each column of a strip.
// sums[strip * pitch + x] is the sum of the depths of those pixels whose depth has a gradient, and
// sums[(strips + strip) * pitch + x] is the number of these pixels.
UBS_KERNEL void depth_sums(int width, int height, int pitch, int rows, UBS_GLOBAL const real* depth,
                           UBS_GLOBAL const real* v_depth, UBS_GLOBAL real* sums) {
  int x = (int)UBS_GLOBAL_ID(0), strip = (int)UBS_GLOBAL_ID(1), strips = rows / kTileSide;
  if (x >= pitch) return;
  real sum = R(0.0), count = R(0.0);
  for (int row = 0; row < kTileSide; ++row) {
    int y = strip * kTileSide + row;
    size_t at = (size_t)y * pitch + x;
    if (x >= width || y >= height || v_depth[at] == R(0.0) || depth[at] == R(0.0)) continue;
    sum += depth[at];
    count += R(1.0);
  }
  sums[(size_t)strip * pitch + x] = sum;
  sums[(size_t)(strips + strip) * pitch + x] = count;
}

// Computes z0, the mean depth, with one work-item. The kernel row_sums (map/row_sums.cl) must run before this kernel.
// It replaces the first element of each row of `sums` by the sum of the row.
UBS_KERNEL void depth_mean(UBS_GLOBAL const real* sums, int pitch, int strips, UBS_GLOBAL real* mean) {
  if (UBS_GLOBAL_ID(0) > 0) return;
  real sum = R(0.0), count = R(0.0);
  for (int s = 0; s < strips; ++s) {
    sum += sums[(size_t)s * pitch];
    count += sums[(size_t)(strips + s) * pitch];
  }
  mean[0] = count > R(0.0) ? sum / count : R(0.0);
}

// Replaces the colours of the projected splats by z - z0, 1 and 0, where z is the depth of the splat.
UBS_KERNEL void depth_to_records(UBS_GLOBAL const real* mean, uint count, UBS_GLOBAL real* records) {
  uint i = UBS_GLOBAL_ID(0);
  if (i >= count) return;
  UBS_GLOBAL real* record = records + (size_t)i * kSplatStride;
  record[kSplatR] = record[kSplatDepth] - mean[0];
  record[kSplatG] = R(1.0);
  record[kSplatB] = R(0.0);
}

// Replaces the image, and its gradient, by those of the pass for depth. Before, the image must have been rendered from
// the result of depth_to_records, so that its green channel is W, the sum of the weights of the splats. The kernel does
// not use 1 - transmittance instead, because the rounding errors of this difference are too large for pixels with a
// small alpha, and these pixels have a depth too.
UBS_KERNEL void depth_to_image(int width, int height, int pitch, int rows, UBS_GLOBAL const real* mean,
                               UBS_GLOBAL const real* depth, UBS_GLOBAL const real* v_depth, UBS_GLOBAL real* image,
                               UBS_GLOBAL real* v_image) {
  uint at = UBS_GLOBAL_ID(0);
  size_t plane = (size_t)pitch * rows;
  if (at >= plane) return;
  real value = R(0.0), v = R(0.0);
  if (at % pitch < (uint)width && at / pitch < (uint)height && image[plane + at] > UBS_FAINTEST_ALPHA) {
    value = depth[at] - mean[0];
    v = v_depth[at] / image[plane + at];
  }
  image[at] = value;
  v_image[at] = v;
  for (uint c = 1; c < 3; ++c) image[c * plane + at] = v_image[c * plane + at] = R(0.0);
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
