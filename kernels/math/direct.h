// SPDX-License-Identifier: Apache-2.0
// Slices a splat at a query with direct conditioning (method.md 9). The quantities that rendering needs are parameters
// themselves, so that no matrix is inverted. x is the query minus the mean, and L is a lower triangular matrix with a
// positive diagonal and Sigma_q^-1 = L L^T:
//   y = L^T x,  z = L y
// The offset of the mean is s sum_i w_i z_i Theta_i, where s is the mean spatial scale, w_i is the weight of query
// dimension i, and the vector Theta_i is a parameter. The functions here compute the offset without the factor s. The
// opacity is computed from y as in method.md 2.4. The spatial covariance does not depend on the query.
// Row i of SliceInput.b contains Theta_i, followed by row i of L.
#pragma once

#if UBS_C > 0 && UBS_DIRECT

UBS_FN Slice slice_forward(SliceInput in) {
  Slice s;
  UBS_UNROLL for (int j = 0; j < UBS_C; ++j) {
    s.y.e[j] = in.b[j][3 + j] * in.x.e[j];
    UBS_UNROLL for (int i = j + 1; i < UBS_C; ++i) s.y.e[j] += in.b[i][3 + j] * in.x.e[i];
  }
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    s.z.e[i] = in.b[i][3] * s.y.e[0];
    UBS_UNROLL for (int j = 1; j <= i; ++j) s.z.e[i] += in.b[i][3 + j] * s.y.e[j];
  }
  if (UBS_BETA_OPACITY != UBS_BETA_OPACITY_NONE) s = slice_attenuation(s);
  return s;
}

UBS_FN Conditional slice_result(SliceInput in, Slice s) {
  Conditional out;
  out.log_factor = slice_log_factor(in, s);
  UBS_UNROLL for (int r = 0; r < 3; ++r) {
    out.offset.e[r] = V(0.0);
    UBS_UNROLL for (int i = 0; i < UBS_C; ++i) out.offset.e[r] += in.b[i][r] * (in.weight.e[i] * s.z.e[i]);
    UBS_UNROLL for (int c = 0; c < 3; ++c) out.shrink.e[r][c] = r == c ? V(1.0) : V(0.0);
  }
  return out;
}

// Returns the gradients of the inputs of the slice. v_k is the gradient of the offset without the factor s.
//   v_Theta_i = w_i z_i v_k,  v_w_i = z_i (Theta_i . v_k),  v_z_i = w_i (Theta_i . v_k)
//   v_y = L^T v_z + gradient through the opacity,  v_x = L v_y,  v_L_ij = v_z_i y_j + x_i v_y_j
UBS_FN SliceVjp slice_vjp(SliceInput in, Slice s, FrameVec v_k, FrameMat v_shrink, vreal v_log) {
  SliceVjp v;
  QueryVec v_y, v_z;
  (void)v_shrink;
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    vreal along = in.b[i][0] * v_k.e[0] + in.b[i][1] * v_k.e[1] + in.b[i][2] * v_k.e[2];
    vreal moved = in.weight.e[i] * s.z.e[i];
    UBS_UNROLL for (int c = 0; c < 3; ++c) v.b[i][c] = moved * v_k.e[c];
    v.weight.e[i] = s.z.e[i] * along;
    v_z.e[i] = in.weight.e[i] * along;
  }
  UBS_UNROLL for (int j = 0; j < UBS_C; ++j) {
    v.exponent.e[j] = V(0.0);
    v_y.e[j] = V(0.0);
    if (UBS_BETA_OPACITY != UBS_BETA_OPACITY_NONE) {
      v.exponent.e[j] = v_log * s.ln.e[j];
      v_y.e[j] = v_log * in.exponent.e[j] * s.slope.e[j];
    }
    UBS_UNROLL for (int i = j; i < UBS_C; ++i) v_y.e[j] += in.b[i][3 + j] * v_z.e[i];
  }
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    v.x.e[i] = V(0.0);
    UBS_UNROLL for (int j = 0; j < UBS_C; ++j) {
      v.b[i][3 + j] = V(0.0);
      if (j > i) continue;
      v.x.e[i] += in.b[i][3 + j] * v_y.e[j];
      v.b[i][3 + j] = v_z.e[i] * s.y.e[j] + in.x.e[i] * v_y.e[j];
    }
  }
  return v;
}

#endif
