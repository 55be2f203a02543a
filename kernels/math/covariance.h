// SPDX-License-Identifier: Apache-2.0
// Computes the rows of the factor L of a splat's covariance Sigma = L L^T (method.md 1.2, 2.1, 8). The spatial rows are
// called the frame M. M has 3 x UBS_F entries, and Sigma_x = M M^T. The query rows are called B and have C x N entries.
// The setting `cov_param` selects how L is computed from the parameters:
// - spatial_ortho: M = R diag(s_x), where R is a rotation matrix, and B = [Lqx, Lq]
// - cholesky: M is lower triangular, and B = [Lqx, Lq]
// - skew_nd: [M; B] = (I + A) diag(s) with a skew N x N matrix A, so that M has N columns
// With spatial_ortho and cholesky, L is block lower triangular, and the columns of M after the third are zero, so
// UBS_F = 3.
#pragma once

// kFrameRots is the number of raw rotation parameters that the frame depends on. frame_row(m) returns the row of the
// m-th of these parameters, counted from 0.
#if UBS_COV_PARAM == UBS_COV_SKEW_ND
#define UBS_F UBS_N
enum { kFrameRots = 3 + 3 * UBS_C };
UBS_FN int frame_row(int m) { return kRowL + (m < 3 ? m : UBS_TRIANGLE(3 + (m - 3) / 3, (m - 3) % 3)); }
#else
#define UBS_F 3
enum { kFrameRots = kRotationParams };
UBS_FN int frame_row(int m) { return kRowL + m; }
#endif

typedef struct {
  vreal e[UBS_F];
} FrameVec;

typedef struct {
  vreal e[3][UBS_F];
} FrameMap;

typedef struct {
  vreal e[UBS_F][UBS_F];
} FrameMat;

// FrameRaw holds the raw parameters of the frame. Their gradients use the same struct.
typedef struct {
  vreal rotation[kFrameRots];
  vreal scale[UBS_F];
} FrameRaw;

typedef struct {
  FrameMap rotation;  // M without its scales
  FrameVec scale;     // positive; radii of the support, or standard deviations for the Gaussian kernel
  FrameMap m;
} SpatialFrame;

// Returns the scales that belong to parameters, and the derivative of a scale with respect to its parameter.
UBS_FN Several scales_from(Several raw, int count) {
  return UBS_GAUSSIAN_ARRAYS ? raw : softplus_several(raw, count);
}
UBS_FN vreal scale_slope(vreal raw) { return UBS_GAUSSIAN_ARRAYS ? V(1.0) : ubs_sigmoid(raw); }

// Returns the scales of the parameters before clamping.
UBS_FN FrameVec frame_scales(FrameRaw raw) {
  Several in;
  FrameVec scale;
  UBS_UNROLL for (int c = 0; c < UBS_F; ++c) in.e[c] = raw.scale[c];
  in = scales_from(in, UBS_F);
  UBS_UNROLL for (int c = 0; c < UBS_F; ++c) scale.e[c] = in.e[c];
  return scale;
}

// Lower bound of a spatial scale, relative to the largest one.
#define UBS_SCALE_LEAST                                                        \
  (UBS_COV_PARAM == UBS_COV_SKEW_ND ? UBS_SKEW_SCALE_RELATIVE                  \
                                    : UBS_COV_PARAM == UBS_COV_CHOLESKY ? UBS_NEEDLE_CHOLESKY : UBS_NEEDLE_RELATIVE)

UBS_FN vreal largest_scale(FrameVec scale) { return ubs_max(scale.e[0], ubs_max(scale.e[1], scale.e[2])); }

UBS_FN vreal mean_scale(FrameVec scale) {
  return (vreal)(R(1.0) / R(3.0)) * (scale.e[0] + scale.e[1] + scale.e[2]);
}

UBS_FN vmask any_scale_floored(FrameVec scale) {
  vreal least = (vreal)(UBS_SCALE_LEAST) * largest_scale(scale);
  return (scale.e[0] < least) | (scale.e[1] < least) | (scale.e[2] < least);
}

// Returns the scales with the spatial ones raised to at least UBS_SCALE_LEAST times the largest of them. The scales of
// query columns are not changed.
UBS_FN FrameVec floored_scales(FrameVec scale) {
  vreal least = (vreal)(UBS_SCALE_LEAST) * largest_scale(scale);
  UBS_UNROLL for (int c = 0; c < 3; ++c) scale.e[c] = ubs_max(scale.e[c], least);
  return scale;
}

// Returns the gradient of the scales from v, the gradient of the result of floored_scales(). The gradient of a raised
// scale is passed to the largest scale (to the first one if several are equal).
UBS_FN FrameVec floored_scales_vjp(FrameVec scale, FrameVec v) {
  vreal most = largest_scale(scale), least = (vreal)(UBS_SCALE_LEAST) * most, passed = V(0.0);
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    vmask raised = scale.e[c] < least;
    passed += raised ? (vreal)(UBS_SCALE_LEAST) * v.e[c] : V(0.0);
    v.e[c] = raised ? V(0.0) : v.e[c];
  }
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    vmask largest = scale.e[c] >= most;
    v.e[c] += largest ? passed : V(0.0);
    passed = largest ? V(0.0) : passed;
  }
  return v;
}

// Returns the gradient of the raw scales from v, the gradient of the scales of the frame. `raised` says whether
// floored_scales() may have raised some of these scales.
UBS_FN FrameVec frame_scales_vjp(FrameRaw raw, FrameVec v, int raised) {
  if (raised) v = floored_scales_vjp(frame_scales(raw), v);
  UBS_UNROLL for (int c = 0; c < UBS_F; ++c) v.e[c] *= scale_slope(raw.scale[c]);
  return v;
}

#if UBS_COV_PARAM == UBS_COV_CHOLESKY

// Returns the lower triangular M. The scales are its diagonal, and the raw rotation parameters are the entries below
// it.
UBS_FN SpatialFrame scaled_frame(FrameRaw raw, FrameVec scale) {
  SpatialFrame f;
  f.scale = scale;
  UBS_UNROLL for (int r = 0; r < 3; ++r)
    UBS_UNROLL for (int c = 0; c < 3; ++c) {
      f.m.e[r][c] = r == c ? f.scale.e[c] : r > c ? raw.rotation[r > c ? UBS_TRIANGLE(r, c) : 0] : V(0.0);
      f.rotation.e[r][c] = f.m.e[r][c];
    }
  return f;
}

UBS_FN FrameRaw scaled_frame_vjp(SpatialFrame f, FrameRaw raw, FrameMap v_m, FrameVec along) {
  FrameRaw v;
  (void)f;
  (void)raw;
  (void)along;
  UBS_UNROLL for (int c = 0; c < 3; ++c) v.scale[c] = v_m.e[c][c];
  v.rotation[0] = v_m.e[1][0];
  v.rotation[1] = v_m.e[2][0];
  v.rotation[2] = v_m.e[2][1];
  return v;
}

#else

UBS_FN RotationRaw frame_rotation(FrameRaw raw) {
  RotationRaw r;
  UBS_UNROLL for (int i = 0; i < kRotationParams; ++i) r.e[i] = raw.rotation[i];
  return r;
}

UBS_FN SpatialFrame scaled_frame(FrameRaw raw, FrameVec scale) {
  SpatialFrame f;
  Mat3 rotation = rotation_matrix(frame_rotation(raw));
  f.scale = scale;
  UBS_UNROLL for (int r = 0; r < 3; ++r)
    UBS_UNROLL for (int c = 0; c < UBS_F; ++c) {
      f.rotation.e[r][c] = c < 3 ? rotation.e[r][c < 3 ? c : 0] : raw.rotation[c < 3 ? 0 : 3 + 3 * (c - 3) + r];
      f.m.e[r][c] = f.rotation.e[r][c] * f.scale.e[c];
    }
  return f;
}

// Returns the gradients of the raw rotation and of the scales. M_rc = R_rc s_c, so v_s_c = sum_r v_M_rc R_rc and
// v_R_rc = v_M_rc s_c (method.md 3.4). The terms of the sum would nearly cancel for a long axis. Therefore the caller
// passes the products s_c v_s_c as `along`. v.scale is the gradient of the scales of the frame, not of the raw scales.
UBS_FN FrameRaw scaled_frame_vjp(SpatialFrame f, FrameRaw raw, FrameMap v_m, FrameVec along) {
  FrameRaw v;
  (void)raw;
  UBS_UNROLL for (int c = 0; c < UBS_F; ++c) {
    v.scale[c] = f.scale.e[c] > (vreal)(UBS_SCALE_MIN) ? along.e[c] / f.scale.e[c] : V(0.0);
    UBS_UNROLL for (int r = 0; r < 3; ++r)
      if (c >= 3) v.rotation[c < 3 ? 0 : 3 + 3 * (c - 3) + r] = v_m.e[r][c] * f.scale.e[c];
  }
#if UBS_ROT_MODE == UBS_ROT_TAYLOR1
  // A is skew, so the gradient of each parameter is the difference of the gradients of two entries of A. Each
  // difference is one expression, so that it compiles to a fused instruction.
  v.rotation[0] = v_m.e[0][1] * f.scale.e[1] - v_m.e[1][0] * f.scale.e[0];
  v.rotation[1] = v_m.e[0][2] * f.scale.e[2] - v_m.e[2][0] * f.scale.e[0];
  v.rotation[2] = v_m.e[1][2] * f.scale.e[2] - v_m.e[2][1] * f.scale.e[1];
#else
  Mat3 v_rotation;
  UBS_UNROLL for (int r = 0; r < 3; ++r)
    UBS_UNROLL for (int c = 0; c < 3; ++c) v_rotation.e[r][c] = v_m.e[r][c] * f.scale.e[c];
  RotationRaw v_raw = rotation_vjp(frame_rotation(raw), v_rotation);
  UBS_UNROLL for (int i = 0; i < kRotationParams; ++i) v.rotation[i] = v_raw.e[i];
#endif
  return v;
}

#endif

UBS_FN SpatialFrame spatial_frame(FrameRaw raw) { return scaled_frame(raw, floored_scales(frame_scales(raw))); }
