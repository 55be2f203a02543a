// SPDX-License-Identifier: Apache-2.0
// Spatial frame of a splat: M = R diag(s_x) with the first-order rotation R = I + A (method.md 1.2, 2.1),
// so that Sigma_x = M M^T. R is not orthogonal: det R = 1 + |omega|^2.
#ifndef UBS_MATH_COVARIANCE_H
#define UBS_MATH_COVARIANCE_H

typedef struct {
  vreal e[3];
} Vec3;

typedef struct {
  vreal e[3][3];
} Mat3;

// Activated spatial parameters; scale > 0 are support radii.
typedef struct {
  Mat3 rotation;
  Vec3 scale;
  Mat3 m;  // column c of the rotation times scale[c]
} SpatialFrame;

// a0, a1, a2 stand with plus in the upper triangle of A.
UBS_FN SpatialFrame spatial_frame(vreal a0, vreal a1, vreal a2, vreal raw_scale0, vreal raw_scale1, vreal raw_scale2) {
  SpatialFrame f;
  vreal one = V(1.0);
  f.rotation.e[0][0] = one;
  f.rotation.e[0][1] = a0;
  f.rotation.e[0][2] = a1;
  f.rotation.e[1][0] = -a0;
  f.rotation.e[1][1] = one;
  f.rotation.e[1][2] = a2;
  f.rotation.e[2][0] = -a1;
  f.rotation.e[2][1] = -a2;
  f.rotation.e[2][2] = one;
  f.scale.e[0] = ubs_softplus(raw_scale0);
  f.scale.e[1] = ubs_softplus(raw_scale1);
  f.scale.e[2] = ubs_softplus(raw_scale2);
  UBS_UNROLL for (int r = 0; r < 3; ++r)
    UBS_UNROLL for (int c = 0; c < 3; ++c) f.m.e[r][c] = f.rotation.e[r][c] * f.scale.e[c];
  return f;
}

typedef struct {
  vreal a0, a1, a2;
  Vec3 raw_scale;
} SpatialFrameVjp;

// M_rc = R_rc s_c: v_s_c = sum_r v_M_rc R_rc, v_R_rc = v_M_rc s_c; A is skew, so each a collects its
// two entries with opposite signs (method.md 3.4).
UBS_FN SpatialFrameVjp spatial_frame_vjp(SpatialFrame f, Vec3 raw_scale, Mat3 v_m) {
  SpatialFrameVjp v;
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    vreal v_scale = v_m.e[0][c] * f.rotation.e[0][c] + v_m.e[1][c] * f.rotation.e[1][c] + v_m.e[2][c] * f.rotation.e[2][c];
    v.raw_scale.e[c] = v_scale * ubs_sigmoid(raw_scale.e[c]);
  }
  v.a0 = v_m.e[0][1] * f.scale.e[1] - v_m.e[1][0] * f.scale.e[0];
  v.a1 = v_m.e[0][2] * f.scale.e[2] - v_m.e[2][0] * f.scale.e[0];
  v.a2 = v_m.e[1][2] * f.scale.e[2] - v_m.e[2][1] * f.scale.e[1];
  return v;
}

#endif
