// SPDX-License-Identifier: Apache-2.0
// The functions of this file slice a splat at a query (view direction, time, ...), which means to condition it on the
// query. The results are the offset of the splat's mean, the matrix that shrinks its spatial covariance, and the
// attenuation of its opacity. All three are computed from the same triangular factor (method.md 2.3, 2.4, 3.3).
//
// Everything is expressed in the splat's own frame M (covariance.h), where Sigma_x is the identity and the query
// coupling is B (C rows of length N, [Lqx, Lq] or dense):
//   Sigma_q = B B^T = Lh Lh^T,  B = Lh [U, U']     (LQ factorisation: the rows of [U, U'] are orthonormal)
//   y = Lh^-1 x,  z = Lh^-1 (bt * x),  Y = Lh^-1 diag(bt) B_F
//   mean offset delta = U^T z,  covariance K = I - U^T Y,  so that mu_c = mu_x + M delta and V = M K M^T.
// M has F columns. F is 3, or N if no block of L is zero. Sigma_xq = M B_F^T, where B_F is the first F columns of B. U
// is the first F columns of the orthonormal rows, so that the formulas hold for F = N as well.
// The vector bt contains the weights of the query dimensions. With `cov_mode whiten`, and if all weights are 1, the
// weights are applied between the factors: z = bt * y, Y = diag(bt) U. This makes K = I - U^T diag(bt) U symmetric and
// positive semidefinite.
// B is factorised instead of B B^T, so that the condition number is not squared. The pivots stay positive in single
// precision in cases where a Cholesky factorisation of Sigma_q would fail.
#pragma once

typedef struct {
  FrameVec offset;   // delta
  FrameMat shrink;   // K; not symmetric if the weights differ
  vreal log_factor;  // ln(o_q / o) <= 0
} Conditional;

// True if the weights are applied between the factors (see above).
#define UBS_WHITEN (UBS_COV_MODE == UBS_COV_WHITEN || UBS_BETA_COND == UBS_BETA_COND_OFF)

#if UBS_C > 0

typedef struct {
  vreal e[UBS_C];
} QueryVec;

typedef struct {
  vreal e[UBS_C][UBS_C];
} QueryMat;

// SliceInput holds the inputs of the slice, after the activation functions. With direct conditioning, `b` has other
// contents, which direct.h describes.
typedef struct {
  vreal b[UBS_C][3 + UBS_C];  // B; entries right of the diagonal of Lq are zero
  QueryVec x;                 // query - mean
  QueryVec exponent;          // 4 exp(b_q); 1 unless UBS_BETA_OPACITY is UBS_BETA_OPACITY_TANH
  QueryVec weight;            // bt = min(exp(b_q), 1); 1 for variants without weights
} SliceInput;

// Slice holds the intermediate results that the backward pass needs.
typedef struct {
#if !UBS_DIRECT
  QueryMat lh;                // lower triangle, positive diagonal
  vreal q[UBS_C][3 + UBS_C];  // orthonormal rows: [U, U']
  vreal yw[UBS_C][UBS_F];     // Y
#endif
  QueryVec y, z;
  QueryVec ln;                // ln(1 - tanh(y^2)), at least UBS_LN_EPS; or -lambda y^2
  QueryVec slope;             // derivative of `ln` with respect to y; 0 where `ln` has its lower bound
} Slice;

typedef struct {
  vreal b[UBS_C][3 + UBS_C];
  QueryVec x, exponent, weight;
} SliceVjp;

// Returns ln(1 - tanh u) for u >= 0. It is computed as ln 2 - 2u - log1p(exp(-2u)), which avoids the cancellation in
// 1 - tanh u. For small u, ln 2 and log1p(exp(-2u)) nearly cancel, which has a visible effect if the exponent is above
// 1e4. Therefore, for u < 1/4, the result is computed as -u - ln(cosh u), with the series of ln(cosh u), whose error is
// 5e-11 at u = 1/4.
UBS_FN Several log_one_minus_tanh(Several u, int count) {
  Several far;
  UBS_EACH(k, count) far.e[k] = V(-2.0) * u.e[k];
  far = log1p_several(exp_several(far, count), count);
  UBS_EACH(k, count) {
    vreal s = u.e[k] * u.e[k];
    vreal cosh = s * (V(0.5) + s * (V(-0.083333333333333333) +
                                    s * (V(0.022222222222222222) +
                                         s * (V(-0.0067460317460317460) + s * V(0.0021869488536155203)))));
    far.e[k] = (vreal)(UBS_LN2) - V(2.0) * u.e[k] - far.e[k];
    far.e[k] = u.e[k] < V(0.25) ? -u.e[k] - cosh : far.e[k];
  }
  return far;
}

// Fills `ln` and `slope` from `y`. Not used with UBS_BETA_OPACITY_NONE.
UBS_FN Slice slice_attenuation(Slice s) {
  Several u, ln;
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    u.e[i] = s.y.e[i] * s.y.e[i];
    u.e[i] = u.e[i] < (vreal)(UBS_U_MAX) ? u.e[i] : (vreal)(UBS_U_MAX);
  }
  if (UBS_BETA_OPACITY == UBS_BETA_OPACITY_TANH) ln = log_one_minus_tanh(u, UBS_C);
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    if (UBS_BETA_OPACITY == UBS_BETA_OPACITY_GAUSSIAN) {
      s.ln.e[i] = -UBS_GAUSSIAN_LAMBDA * u.e[i];
      s.slope.e[i] = u.e[i] < (vreal)(UBS_U_MAX) ? R(-2.0) * UBS_GAUSSIAN_LAMBDA * s.y.e[i] : V(0.0);
    } else {
      vmask open = ln.e[i] > (vreal)(UBS_LN_EPS);
      s.ln.e[i] = open ? ln.e[i] : (vreal)(UBS_LN_EPS);
      // d ln(1 - tanh u)/du = -(1 + tanh u) = -2 sigmoid(2u), du/dy = 2y.
      s.slope.e[i] = open ? V(-4.0) * ubs_sigmoid(V(2.0) * u.e[i]) * s.y.e[i] : V(0.0);
    }
  }
  return s;
}

UBS_FN vreal slice_log_factor(SliceInput in, Slice s) {
  vreal sum = V(0.0);
  if (UBS_BETA_OPACITY != UBS_BETA_OPACITY_NONE)
    UBS_UNROLL for (int i = 0; i < UBS_C; ++i) sum += in.exponent.e[i] * s.ln.e[i];
  return sum;
}

#if !UBS_DIRECT

// Solves Lh a = rhs.
UBS_FN QueryVec query_solve(QueryMat lh, QueryVec rhs) {
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    UBS_UNROLL for (int j = 0; j < i; ++j) rhs.e[i] -= lh.e[i][j] * rhs.e[j];
    rhs.e[i] = rhs.e[i] / lh.e[i][i];
  }
  return rhs;
}

// Solves Lh^T a = rhs.
UBS_FN QueryVec query_solve_transposed(QueryMat lh, QueryVec rhs) {
  UBS_UNROLL for (int i = UBS_C - 1; i >= 0; --i) {
    UBS_UNROLL for (int j = i + 1; j < UBS_C; ++j) rhs.e[i] -= lh.e[j][i] * rhs.e[j];
    rhs.e[i] = rhs.e[i] / lh.e[i][i];
  }
  return rhs;
}

// Number of passes of Gram-Schmidt on the rows of B. In each pass a row is made orthogonal to all rows before it. One
// pass is not enough if Lq << Lqx and C > 3, because then the rows would be linearly dependent without Lq. After the
// first pass, the remainder of a row is orthogonal to the other rows only up to rounding errors divided by Lq, and V
// and its gradients multiply this error by Lq^-2. After the second pass, only rounding errors remain. With two passes,
// errors stay within 1e-3 for condition numbers of Sigma_q up to 1e7, with one pass only up to 1e4
// (docs/results/2026-11-20-stability-sweeps.md).
enum { kOrthogonalPasses = UBS_C > 3 ? 2 : 1 };

// Factorises B = Lh [U, U']. splat.h bounds the query scales from below, which also bounds the pivots. Only rows of
// zeros have smaller pivots; for such rows, the lower bound UBS_PIVOT_ABSOLUTE keeps the results finite.
UBS_FN Slice slice_factor(SliceInput in) {
  Slice s;
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    vreal row[3 + UBS_C];
    UBS_UNROLL for (int k = 0; k < 3 + UBS_C; ++k) row[k] = in.b[i][k];
    UBS_UNROLL for (int j = 0; j < UBS_C; ++j) s.lh.e[i][j] = V(0.0);
    UBS_UNROLL for (int pass = 0; pass < kOrthogonalPasses; ++pass)
      UBS_UNROLL for (int j = 0; j < i; ++j) {
        vreal dot = V(0.0);
        UBS_UNROLL for (int k = 0; k < 3 + UBS_C; ++k) dot += s.q[j][k] * row[k];
        s.lh.e[i][j] += dot;
        UBS_UNROLL for (int k = 0; k < 3 + UBS_C; ++k) row[k] -= dot * s.q[j][k];
      }
    vreal rest2 = V(0.0);
    UBS_UNROLL for (int k = 0; k < 3 + UBS_C; ++k) rest2 += row[k] * row[k];
    vreal pivot = ubs_sqrt(rest2);
    pivot = pivot > (vreal)(UBS_PIVOT_ABSOLUTE) ? pivot : (vreal)(UBS_PIVOT_ABSOLUTE);
    s.lh.e[i][i] = pivot;
    UBS_UNROLL for (int k = 0; k < 3 + UBS_C; ++k) s.q[i][k] = row[k] / pivot;
  }
  return s;
}

UBS_FN Slice slice_forward(SliceInput in) {
  Slice s = slice_factor(in);
  s.y = query_solve(s.lh, in.x);
  if (UBS_WHITEN) {
    UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
      s.z.e[i] = in.weight.e[i] * s.y.e[i];
      UBS_UNROLL for (int c = 0; c < UBS_F; ++c) s.yw[i][c] = in.weight.e[i] * s.q[i][c];
    }
  } else {
    QueryVec weighted;
    UBS_UNROLL for (int i = 0; i < UBS_C; ++i) weighted.e[i] = in.weight.e[i] * in.x.e[i];
    s.z = query_solve(s.lh, weighted);
    UBS_UNROLL for (int c = 0; c < UBS_F; ++c) {
      QueryVec column;
      UBS_UNROLL for (int i = 0; i < UBS_C; ++i) column.e[i] = in.weight.e[i] * in.b[i][c];
      column = query_solve(s.lh, column);
      UBS_UNROLL for (int i = 0; i < UBS_C; ++i) s.yw[i][c] = column.e[i];
    }
  }
  if (UBS_BETA_OPACITY != UBS_BETA_OPACITY_NONE) s = slice_attenuation(s);
  return s;
}

UBS_FN Conditional slice_result(SliceInput in, Slice s) {
  Conditional out;
  out.log_factor = slice_log_factor(in, s);
  UBS_UNROLL for (int r = 0; r < UBS_F; ++r) {
    out.offset.e[r] = V(0.0);
    UBS_UNROLL for (int i = 0; i < UBS_C; ++i) out.offset.e[r] += s.q[i][r] * s.z.e[i];
    UBS_UNROLL for (int c = 0; c < UBS_F; ++c) {
      vreal sum = V(0.0);
      UBS_UNROLL for (int i = 0; i < UBS_C; ++i) sum += s.q[i][r] * s.yw[i][c];
      out.shrink.e[r][c] = (r == c ? V(1.0) : V(0.0)) - sum;
    }
  }
  return out;
}

// Returns the gradients of the inputs of the slice. v_k, v_shrink and v_log are the gradients of offset, shrink and
// log_factor. Each solution a of Lh a = rhs gives v_rhs = Lh^-T v_a and v_Lh -= v_rhs a^T. The factorisation B = Lh Q
// gives
//   v_B = v_B(direct) + Lh^-T (F + F^T) Q,
// where v_B(direct) is the gradient from direct uses of B, and F is the lower triangle of Lh^T v_Lh with halved
// diagonal. This is equivalent to the derivative of the Cholesky factorisation of Sq = B B^T: the second term is
// 2 v_Sq B with v_Sq = Lh^-T (F + F^T) Lh^-1 / 2.
UBS_FN SliceVjp slice_vjp(SliceInput in, Slice s, FrameVec v_k, FrameMat v_shrink, vreal v_log) {
  SliceVjp v;
  QueryMat v_lh;
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i)
    UBS_UNROLL for (int j = 0; j < UBS_C; ++j) v_lh.e[i][j] = V(0.0);

  // The opacity: log_factor = sum exponent_i ln_i(y_i). The gradient of the exponent is not zero where ln has its lower
  // bound.
  QueryVec v_y;
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    if (UBS_BETA_OPACITY != UBS_BETA_OPACITY_NONE) {
      v.exponent.e[i] = v_log * s.ln.e[i];
      v_y.e[i] = v_log * in.exponent.e[i] * s.slope.e[i];
    } else {
      v.exponent.e[i] = V(0.0);
      v_y.e[i] = V(0.0);
    }
  }

  // The offset of the mean: delta = U^T z.
  QueryVec v_z;
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    v_z.e[i] = s.q[i][0] * v_k.e[0];
    UBS_UNROLL for (int c = 1; c < UBS_F; ++c) v_z.e[i] += s.q[i][c] * v_k.e[c];
  }
  if (UBS_WHITEN) {
    UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
      v.weight.e[i] = v_z.e[i] * s.y.e[i];
      v_y.e[i] += v_z.e[i] * in.weight.e[i];
    }
  }
  v.x = v_y;
  if (UBS_WHITEN + (UBS_BETA_OPACITY != UBS_BETA_OPACITY_NONE) > 0) v.x = query_solve_transposed(s.lh, v_y);
  if (UBS_WHITEN) {
    // Accumulates Lh^T v_Lh directly. Multiplying by Lh^-T first and by Lh^T afterwards would enlarge values only to
    // reduce them again.
    UBS_UNROLL for (int i = 0; i < UBS_C; ++i)
      UBS_UNROLL for (int j = 0; j <= i; ++j) v_lh.e[i][j] -= v_y.e[i] * s.y.e[j];
  } else {
    QueryVec v_weighted = query_solve_transposed(s.lh, v_z);
    UBS_UNROLL for (int i = 0; i < UBS_C; ++i)
      UBS_UNROLL for (int j = 0; j <= i; ++j) v_lh.e[i][j] -= v.x.e[i] * s.y.e[j] + v_weighted.e[i] * s.z.e[j];
    UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
      v.weight.e[i] = v_weighted.e[i] * in.x.e[i];
      v.x.e[i] += v_weighted.e[i] * in.weight.e[i];
    }
  }
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i)
    UBS_UNROLL for (int k = UBS_F; k < 3 + UBS_C; ++k) v.b[i][k] = V(0.0);

  // The covariance: K = I - U^T Y with U = Lh^-1 B_F. The columns are processed one by one.
  UBS_UNROLL for (int c = 0; c < UBS_F; ++c) {
    QueryVec v_u, v_yw;
    UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
      v_u.e[i] = s.z.e[i] * v_k.e[c];
      v_yw.e[i] = V(0.0);
      UBS_UNROLL for (int r = 0; r < UBS_F; ++r) {
        v_u.e[i] -= s.yw[i][r] * v_shrink.e[c][r];
        v_yw.e[i] -= s.q[i][r] * v_shrink.e[r][c];
      }
    }
    if (UBS_WHITEN) {
      UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
        v.weight.e[i] += v_yw.e[i] * s.q[i][c];
        v_u.e[i] += v_yw.e[i] * in.weight.e[i];
      }
      UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
        v.b[i][c] = v_u.e[i];  // is multiplied by Lh^-T below
        UBS_UNROLL for (int j = 0; j <= i; ++j) v_lh.e[i][j] -= v_u.e[i] * s.q[j][c];
      }
    } else {
      v_u = query_solve_transposed(s.lh, v_u);
      v_yw = query_solve_transposed(s.lh, v_yw);
      UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
        v.b[i][c] = v_u.e[i] + in.weight.e[i] * v_yw.e[i];
        v.weight.e[i] += v_yw.e[i] * in.b[i][c];
        UBS_UNROLL for (int j = 0; j <= i; ++j) v_lh.e[i][j] -= v_u.e[i] * s.q[j][c] + v_yw.e[i] * s.yw[j][c];
      }
    }
  }

  // The factorisation B = Lh Q.
  QueryMat f;
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i)
    UBS_UNROLL for (int j = 0; j <= i; ++j) {
      vreal sum = V(0.0);
      UBS_UNROLL for (int k = i; k < UBS_C; ++k) sum += s.lh.e[k][i] * v_lh.e[k][j];
      if (UBS_WHITEN) sum = v_lh.e[i][j];
      f.e[i][j] = sum;
      f.e[j][i] = sum;  // F + F^T: the diagonal is halved, then added twice
    }
  UBS_UNROLL for (int k = 0; k < 3 + UBS_C; ++k) {
    QueryVec column;
    UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
      column.e[i] = UBS_WHITEN ? v.b[i][k] : V(0.0);
      UBS_UNROLL for (int j = 0; j < UBS_C; ++j) column.e[i] += f.e[i][j] * s.q[j][k];
    }
    column = query_solve_transposed(s.lh, column);
    if (UBS_WHITEN) {
      UBS_UNROLL for (int i = 0; i < UBS_C; ++i) v.b[i][k] = column.e[i];
    } else {
      UBS_UNROLL for (int i = 0; i < UBS_C; ++i) v.b[i][k] += column.e[i];
    }
  }
  return v;
}

#if UBS_F == 3
// The following functions compute K in a second way, for strongly coupled splats. If a query scale is only the fraction
// 1/t of its row and its weight is 1 or nearly 1, K has eigenvalues of t^-2, but I - U^T Y has an absolute error of
// 1e-7.
// If all weights are 1, K is the leading block of I - B^+ B, the projection onto the null space of B. So K = W^T W,
// where [W, Z] is an orthonormal basis of this null space, computed by Householder reflections of the rows of B. W has
// an absolute error of 1e-7, and so have its small singular values t^-1. With the frame M W^T, the splat can then be
// treated like a splat without query dimensions.
// If the weights are 1 - e, the matrix D = U^T Lh^-1 diag(e) B_F (`cov_mode whiten`: D = U^T diag(e) U) is added to K:
//   K = W^T K' W,  K' = I + W^-T D W^-1 = I + G^T Lh^-1 diag(e) Lh G,  G = U W^-1.
// Then M W^T is the frame, and K' takes the role of K.
// The error of this computation, relative to the smallest eigenvalue of K, is 1e-7 e t^3. The relative error of
// I - U^T Y is 1e-7 t^2, or 1e-7 / e if no weight is closer to 1 than 1 - e. Therefore this computation is only used if
// the weights of all strongly coupled dimensions are above 1 - UBS_COUPLED_WEIGHT (splat_thin()), and if the sum of the
// absolute entries of K' is below UBS_COUPLED_SHRINK.
#define UBS_COUPLED_FACTOR

typedef struct {
  vreal e[3][3 + UBS_C];  // [W, Z]
} CoupledFactor;

UBS_FN CoupledFactor coupled_factor(SliceInput in) {
  CoupledFactor out;
  // Reflection i maps a vector a to a - gain[i] (v[i] . a) v[i]. The entries of v[i] before entry i are zero.
  vreal v[UBS_C][3 + UBS_C], gain[UBS_C];
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    UBS_UNROLL for (int k = 0; k < 3 + UBS_C; ++k) v[i][k] = in.b[i][k];
    UBS_UNROLL for (int j = 0; j < i; ++j) {
      vreal along = V(0.0);
      UBS_UNROLL for (int k = j; k < 3 + UBS_C; ++k) along += v[j][k] * v[i][k];
      along *= gain[j];
      UBS_UNROLL for (int k = j; k < 3 + UBS_C; ++k) v[i][k] -= along * v[j][k];
    }
    vreal rest2 = V(0.0);
    UBS_UNROLL for (int k = i + 1; k < 3 + UBS_C; ++k) rest2 += v[i][k] * v[i][k];
    vreal length = ubs_sqrt(rest2 + v[i][i] * v[i][i]);
    v[i][i] += v[i][i] < V(0.0) ? -length : length;
    vreal square = rest2 + v[i][i] * v[i][i];
    gain[i] = square > V(0.0) ? V(2.0) / square : V(0.0);
  }
  UBS_UNROLL for (int r = 0; r < 3; ++r) {
    UBS_UNROLL for (int k = 0; k < 3 + UBS_C; ++k) out.e[r][k] = k == UBS_C + r ? V(1.0) : V(0.0);
    UBS_UNROLL for (int i = UBS_C - 1; i >= 0; --i) {
      vreal along = V(0.0);
      UBS_UNROLL for (int k = i; k < 3 + UBS_C; ++k) along += v[i][k] * out.e[r][k];
      along *= gain[i];
      UBS_UNROLL for (int k = i; k < 3 + UBS_C; ++k) out.e[r][k] -= along * v[i][k];
    }
  }
  return out;
}

// Returns M W^T.
UBS_FN FrameMap coupled_frame(FrameMap m, CoupledFactor k) {
  FrameMap out;
  UBS_UNROLL for (int r = 0; r < 3; ++r)
    UBS_UNROLL for (int i = 0; i < 3; ++i)
      out.e[r][i] = m.e[r][0] * k.e[i][0] + m.e[r][1] * k.e[i][1] + m.e[r][2] * k.e[i][2];
  return out;
}

// CoupledInverse holds the factorisation W = Q R. The columns of Q are orthonormal, and R is upper triangular.
typedef struct {
  vreal q[3][3];
  vreal r01, r02, r12, pivot[3];  // the entries of R above the diagonal, and its diagonal
} CoupledInverse;

UBS_FN CoupledInverse coupled_inverse(CoupledFactor k) {
  CoupledInverse w;
  vreal along[3];
  w.r01 = w.r02 = w.r12 = V(0.0);
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    UBS_UNROLL for (int r = 0; r < 3; ++r) w.q[r][c] = k.e[r][c];
    UBS_UNROLL for (int j = 0; j < c; ++j) {
      along[j] = w.q[0][j] * w.q[0][c] + w.q[1][j] * w.q[1][c] + w.q[2][j] * w.q[2][c];
      UBS_UNROLL for (int r = 0; r < 3; ++r) w.q[r][c] -= along[j] * w.q[r][j];
    }
    if (c == 1) w.r01 = along[0];
    if (c == 2) {
      w.r02 = along[0];
      w.r12 = along[1];
    }
    vreal length = ubs_sqrt(w.q[0][c] * w.q[0][c] + w.q[1][c] * w.q[1][c] + w.q[2][c] * w.q[2][c]);
    w.pivot[c] = ubs_max(length, (vreal)(UBS_PIVOT_ABSOLUTE));
    UBS_UNROLL for (int r = 0; r < 3; ++r) w.q[r][c] = w.q[r][c] / w.pivot[c];
  }
  return w;
}

// Returns a W^-1 for a row vector a.
UBS_FN Vec3 coupled_row(CoupledInverse w, vreal a0, vreal a1, vreal a2) {
  a0 = a0 / w.pivot[0];
  a1 = (a1 - a0 * w.r01) / w.pivot[1];
  a2 = (a2 - a0 * w.r02 - a1 * w.r12) / w.pivot[2];
  Vec3 out;
  UBS_UNROLL for (int i = 0; i < 3; ++i) out.e[i] = a0 * w.q[i][0] + a1 * w.q[i][1] + a2 * w.q[i][2];
  return out;
}

typedef struct {
  vreal g[UBS_C][3];  // G
  QueryMat pull;      // lower triangle of Lh^-1 diag(e) Lh; with `cov_mode whiten` diag(e)
  FrameMat shrink;    // K'
} CoupledWeights;

// Computes K' and the matrices from which it is built. `below` contains e, the differences between 1 and the weights.
UBS_FN CoupledWeights coupled_weights(Slice s, CoupledFactor k, QueryVec below) {
  CoupledWeights out;
  CoupledInverse w = coupled_inverse(k);
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    Vec3 g = coupled_row(w, s.q[i][0], s.q[i][1], s.q[i][2]);
    UBS_UNROLL for (int c = 0; c < 3; ++c) out.g[i][c] = g.e[c];
  }
  UBS_UNROLL for (int j = 0; j < UBS_C; ++j) {
    QueryVec column;
    if (UBS_WHITEN) {
      UBS_UNROLL for (int i = 0; i < UBS_C; ++i) column.e[i] = i == j ? below.e[i] : V(0.0);
    } else {
      UBS_UNROLL for (int i = 0; i < UBS_C; ++i) column.e[i] = i < j ? V(0.0) : below.e[i] * s.lh.e[i][j];
      column = query_solve(s.lh, column);
    }
    UBS_UNROLL for (int i = 0; i < UBS_C; ++i) out.pull.e[i][j] = column.e[i];
  }
  UBS_UNROLL for (int r = 0; r < 3; ++r)
    UBS_UNROLL for (int c = 0; c < 3; ++c) out.shrink.e[r][c] = r == c ? V(1.0) : V(0.0);
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i)
    UBS_UNROLL for (int c = 0; c < 3; ++c) {
      vreal p = out.pull.e[i][0] * out.g[0][c];
      UBS_UNROLL for (int j = 1; j <= i; ++j) p += out.pull.e[i][j] * out.g[j][c];
      UBS_UNROLL for (int r = 0; r < 3; ++r) out.shrink.e[r][c] += out.g[i][r] * p;
    }
  return out;
}

// ShrinkVjp holds the gradient v_K with respect to K or K', stored as factors: v_K = h^T W h + m^T S m, where m is the
// frame, h = t m, and S is a skew matrix. The factors are kept, because in the entries of v_K the part of a short axis
// would be lost in the rounding errors of the part of a long axis.
typedef struct {
  vreal h[2][3], t[2][3], w00, w01, w11;
  vreal turn[3];  // the entries S_01, S_02 and S_12
} ShrinkVjp;

// Returns S m for a column m.
UBS_FN Vec3 shrink_turn(ShrinkVjp v, vreal m0, vreal m1, vreal m2) {
  Vec3 out;
  out.e[0] = v.turn[0] * m1 + v.turn[1] * m2;
  out.e[1] = v.turn[2] * m2 - v.turn[0] * m0;
  out.e[2] = -(v.turn[1] * m0 + v.turn[2] * m1);
  return out;
}

typedef struct {
  FrameMap m;
  FrameVec along;             // sum over r of v_M_rc M_rc
  vreal b[UBS_C][3 + UBS_C];  // the part of the gradient of B that goes through W and K'
  QueryVec weight;            // the part of the gradient of the weights that goes through K'
} CoupledVjp;

// Returns the gradients of the inputs of coupled_frame() and coupled_weights(). v is the gradient of the frame M W^T,
// and v_k the gradient of K', expressed in this frame. The gradient of M is v_M = v W. Let T = Lh^-1 dB [W, Z]^T,
// E = Lh^-1 diag(e) Lh, and let S be the skew part of Lh^-1 dB Q^T. Then
//   dW = -T^T U,  dG = S G + T + G T^T G,  K' = I + G^T E G.
// With N = G v_K' G^T and v_G = E G v_K'^T + E^T G v_K' this gives
//   v_T = v_G + G v_G^T G - U M^T v,  v_B = Lh^-T (v_T [W, Z] + (F + F^T + X) Q),  v_e = diag(Lh^-T N Lh^T).
// F is the lower triangle of E^T N - N E^T with halved diagonal. X is the strict upper triangle of v_S - v_S^T with
// v_S = v_G G^T = E N^T + E^T N. Along the short axes of W, G^T is large and v_K' is small; therefore N is computed
// from G h^T = G W M^T t^T = U M^T t^T.
UBS_FN CoupledVjp coupled_vjp(Slice s, FrameMap m, FrameMap frame, CoupledFactor k, QueryVec below, FrameMap v,
                              ShrinkVjp v_k) {
  CoupledVjp out;
  CoupledWeights f = coupled_weights(s, k, below);
  vreal v_t[UBS_C][3], gh[UBS_C][2], gw[UBS_C][2], um[UBS_C][3];
  UBS_UNROLL for (int c = 0; c < 3; ++c)
    UBS_UNROLL for (int i = 0; i < UBS_C; ++i)
      um[i][c] = s.q[i][0] * m.e[c][0] + s.q[i][1] * m.e[c][1] + s.q[i][2] * m.e[c][2];
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    UBS_UNROLL for (int r = 0; r < 2; ++r)
      gh[i][r] = um[i][0] * v_k.t[r][0] + um[i][1] * v_k.t[r][1] + um[i][2] * v_k.t[r][2];
    gw[i][0] = gh[i][0] * v_k.w00 + gh[i][1] * v_k.w01;
    gw[i][1] = gh[i][0] * v_k.w01 + gh[i][1] * v_k.w11;
  }
  QueryMat n;
  UBS_UNROLL for (int j = 0; j < UBS_C; ++j) {
    Vec3 turned = shrink_turn(v_k, um[j][0], um[j][1], um[j][2]);
    UBS_UNROLL for (int i = 0; i < UBS_C; ++i)
      n.e[i][j] = gh[i][0] * gw[j][0] + gh[i][1] * gw[j][1] + um[i][0] * turned.e[0] + um[i][1] * turned.e[1] +
                  um[i][2] * turned.e[2];
  }
  // The diagonal of Lh^-T N Lh^T. Column i of Lh^-T (N Lh^T) gives its entry i.
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    if (UBS_WHITEN) {
      out.weight.e[i] = -n.e[i][i];
    } else {
      QueryVec column;
      UBS_UNROLL for (int j = 0; j < UBS_C; ++j) {
        column.e[j] = n.e[j][0] * s.lh.e[i][0];
        UBS_UNROLL for (int l = 1; l <= i; ++l) column.e[j] += n.e[j][l] * s.lh.e[i][l];
      }
      out.weight.e[i] = -query_solve_transposed(s.lh, column).e[i];
    }
  }
  QueryMat v_s, x;
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i)
    UBS_UNROLL for (int j = 0; j < UBS_C; ++j) {
      vreal across = V(0.0), along = V(0.0);  // entries of E^T N and of E N^T
      UBS_UNROLL for (int l = i; l < UBS_C; ++l) across += f.pull.e[l][i] * n.e[l][j];
      UBS_UNROLL for (int l = 0; l <= i; ++l) along += f.pull.e[i][l] * n.e[j][l];
      v_s.e[i][j] = across + along;
      x.e[i][j] = V(0.0);
      if (!UBS_WHITEN && j <= i) {
        UBS_UNROLL for (int l = 0; l <= j; ++l) across -= n.e[i][l] * f.pull.e[j][l];
        x.e[i][j] = across;
      }
    }
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i)
    UBS_UNROLL for (int j = 0; j < i; ++j) x.e[j][i] = x.e[i][j] + v_s.e[j][i] - v_s.e[i][j];
  // The columns of M^T v / 2, G v_K' and G v_K'^T are computed one at a time.
  UBS_UNROLL for (int c = 0; c < 3; ++c) out.along.e[c] = V(0.0);
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    Vec3 half_v, turned = shrink_turn(v_k, frame.e[0][c], frame.e[1][c], frame.e[2][c]);
    UBS_UNROLL for (int j = 0; j < 3; ++j) {
      half_v.e[j] = V(0.5) * (m.e[0][j] * v.e[0][c] + m.e[1][j] * v.e[1][c] + m.e[2][j] * v.e[2][c]);
      out.along.e[j] += V(2.0) * (k.e[c][j] * half_v.e[j]);
    }
    vreal gv[UBS_C], gv_mirrored[UBS_C];
    UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
      vreal same = gw[i][0] * v_k.h[0][c] + gw[i][1] * v_k.h[1][c];
      vreal skew = um[i][0] * turned.e[0] + um[i][1] * turned.e[1] + um[i][2] * turned.e[2];
      gv[i] = same + skew;
      gv_mirrored[i] = same - skew;
      v_t[i][c] = V(-2.0) * (s.q[i][0] * half_v.e[0] + s.q[i][1] * half_v.e[1] + s.q[i][2] * half_v.e[2]);
    }
    UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
      UBS_UNROLL for (int l = 0; l <= i; ++l) v_t[i][c] += f.pull.e[i][l] * gv_mirrored[l];
      UBS_UNROLL for (int l = i; l < UBS_C; ++l) v_t[i][c] += f.pull.e[l][i] * gv[l];
      UBS_UNROLL for (int l = 0; l < UBS_C; ++l) v_t[i][c] += v_s.e[l][i] * f.g[l][c];
    }
  }
  UBS_UNROLL for (int c = 0; c < 3; ++c)
    UBS_UNROLL for (int r = 0; r < 3; ++r)
      out.m.e[r][c] = v.e[r][0] * k.e[0][c] + v.e[r][1] * k.e[1][c] + v.e[r][2] * k.e[2][c];
  UBS_UNROLL for (int j = 0; j < 3 + UBS_C; ++j) {
    QueryVec column;
    UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
      column.e[i] = v_t[i][0] * k.e[0][j] + v_t[i][1] * k.e[1][j] + v_t[i][2] * k.e[2][j];
      UBS_UNROLL for (int l = 0; l < UBS_C; ++l) column.e[i] += x.e[i][l] * s.q[l][j];
    }
    column = query_solve_transposed(s.lh, column);
    UBS_UNROLL for (int i = 0; i < UBS_C; ++i) out.b[i][j] = column.e[i];
  }
  return out;
}
#endif

#endif  // !UBS_DIRECT

#endif  // UBS_C > 0
