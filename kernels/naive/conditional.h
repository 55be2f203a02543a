// SPDX-License-Identifier: Apache-2.0
// The textbook evaluation of math/conditional.h, with its interface and for the published form only: Sigma_q = B B^T,
// its Cholesky factor Lh and its inverse P, the gain G = B_F^T P diag(bt), and 1 - tanh(u) by subtraction (method.md
// 2.3, 2.4, 3.3). Only `ubs sweep` compiles it, to show where it breaks in single precision.
#ifndef UBS_NAIVE_CONDITIONAL_H
#define UBS_NAIVE_CONDITIONAL_H

#define UBS_WHITEN 0

typedef struct {
  FrameVec offset;
  FrameMat shrink;
  vreal log_factor;
} Conditional;

#if UBS_C > 0

typedef struct {
  vreal e[UBS_C];
} QueryVec;

typedef struct {
  vreal e[UBS_C][UBS_C];
} QueryMat;

typedef struct {
  vreal b[UBS_C][3 + UBS_C];
  QueryVec x, exponent, weight;
} SliceInput;

typedef struct {
  QueryMat w, p;           // Lh^-1 and Sigma_q^-1
  vreal gain[3][UBS_C];    // G
  QueryVec y, ln, slope;
} Slice;

UBS_FN Slice slice_forward(SliceInput in) {
  Slice s;
  QueryMat lh;
  UBS_UNROLL for (int j = 0; j < UBS_C; ++j)
    UBS_UNROLL for (int i = j; i < UBS_C; ++i) {
      vreal sum = V(0.0);
      UBS_UNROLL for (int k = 0; k < 3 + UBS_C; ++k) sum += in.b[i][k] * in.b[j][k];
      UBS_UNROLL for (int k = 0; k < j; ++k) sum -= lh.e[i][k] * lh.e[j][k];
      lh.e[i][j] = i == j ? ubs_sqrt(sum > V(1e-20) ? sum : V(1e-20)) : sum / lh.e[j][j];
    }
  UBS_UNROLL for (int c = 0; c < UBS_C; ++c)
    UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
      vreal sum = i == c ? V(1.0) : V(0.0);
      UBS_UNROLL for (int k = c; k < i; ++k) sum -= lh.e[i][k] * s.w.e[k][c];
      s.w.e[i][c] = i < c ? V(0.0) : sum / lh.e[i][i];
    }
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    s.y.e[i] = V(0.0);
    UBS_UNROLL for (int j = 0; j < UBS_C; ++j) {
      s.y.e[i] += s.w.e[i][j] * in.x.e[j];
      s.p.e[i][j] = V(0.0);
      UBS_UNROLL for (int k = 0; k < UBS_C; ++k) s.p.e[i][j] += s.w.e[k][i] * s.w.e[k][j];
    }
  }
  UBS_UNROLL for (int r = 0; r < 3; ++r)
    UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
      vreal sum = V(0.0);
      UBS_UNROLL for (int j = 0; j < UBS_C; ++j) sum += in.b[j][r] * s.p.e[j][i];
      s.gain[r][i] = sum * in.weight.e[i];
    }
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    vreal e = ubs_exp(V(-2.0) * s.y.e[i] * s.y.e[i]);
    vreal d = (V(1.0) - e) / (V(1.0) + e);  // tanh(y^2)
    vreal most = V(1.0) - V(1.1920929e-7);
    vmask open = d < most;
    d = open ? d : most;
    s.ln.e[i] = ubs_log(V(1.0) - d);
    s.slope.e[i] = open ? V(-2.0) * s.y.e[i] * (V(1.0) - d * d) / (V(1.0) - d) : V(0.0);
  }
  return s;
}

UBS_FN Conditional slice_result(SliceInput in, Slice s) {
  Conditional out;
  out.log_factor = V(0.0);
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) out.log_factor += in.exponent.e[i] * s.ln.e[i];
  UBS_UNROLL for (int r = 0; r < 3; ++r) {
    out.offset.e[r] = V(0.0);
    UBS_UNROLL for (int i = 0; i < UBS_C; ++i) out.offset.e[r] += s.gain[r][i] * in.x.e[i];
    UBS_UNROLL for (int c = 0; c < 3; ++c) {
      out.shrink.e[r][c] = r == c ? V(1.0) : V(0.0);
      UBS_UNROLL for (int i = 0; i < UBS_C; ++i) out.shrink.e[r][c] -= s.gain[r][i] * in.b[i][c];
    }
  }
  return out;
}

typedef struct {
  vreal b[UBS_C][3 + UBS_C];
  QueryVec x, exponent, weight;
} SliceVjp;

// In the frame: v_G = v_k x^T - v_K B_F^T, E = v_G diag(bt), v_Sq = -P B_F E P - W^T S W / 2, v_B = (v_Sq + v_Sq^T) B
// beside P E^T and -G^T v_K in its first three columns.
UBS_FN SliceVjp slice_vjp(SliceInput in, Slice s, FrameVec v_k, FrameMat v_shrink, vreal v_log) {
  SliceVjp v;
  vreal e[3][UBS_C];
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    v.exponent.e[i] = v_log * s.ln.e[i];
    v.weight.e[i] = V(0.0);
    UBS_UNROLL for (int r = 0; r < 3; ++r) {
      vreal v_gain = v_k.e[r] * in.x.e[i];
      UBS_UNROLL for (int c = 0; c < 3; ++c) v_gain -= v_shrink.e[r][c] * in.b[i][c];
      vreal xp = V(0.0);
      UBS_UNROLL for (int j = 0; j < UBS_C; ++j) xp += in.b[j][r] * s.p.e[j][i];
      v.weight.e[i] += xp * v_gain;
      e[r][i] = v_gain * in.weight.e[i];
    }
  }
  QueryVec v_y;
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) v_y.e[i] = v_log * in.exponent.e[i] * s.slope.e[i];
  QueryMat be, pbe, v_sq;
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    v.x.e[i] = V(0.0);
    UBS_UNROLL for (int r = 0; r < 3; ++r) v.x.e[i] += s.gain[r][i] * v_k.e[r];
    UBS_UNROLL for (int j = 0; j < UBS_C; ++j) {
      v.x.e[i] += s.w.e[j][i] * v_y.e[j];
      be.e[i][j] = in.b[i][0] * e[0][j] + in.b[i][1] * e[1][j] + in.b[i][2] * e[2][j];
    }
  }
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i)
    UBS_UNROLL for (int j = 0; j < UBS_C; ++j) {
      pbe.e[i][j] = V(0.0);
      UBS_UNROLL for (int k = 0; k < UBS_C; ++k) pbe.e[i][j] += s.p.e[i][k] * be.e[k][j];
    }
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i)
    UBS_UNROLL for (int j = 0; j < UBS_C; ++j) {
      vreal sum = V(0.0);
      UBS_UNROLL for (int k = 0; k < UBS_C; ++k) {
        sum -= pbe.e[i][k] * s.p.e[k][j];
        UBS_UNROLL for (int l = 0; l < UBS_C; ++l)
          sum -= V(0.5) * s.w.e[k][i] * (v_y.e[k > l ? k : l] * s.y.e[k > l ? l : k]) * s.w.e[l][j];
      }
      v_sq.e[i][j] = sum;
    }
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i)
    UBS_UNROLL for (int c = 0; c < 3 + UBS_C; ++c) {
      vreal sum = V(0.0);
      UBS_UNROLL for (int j = 0; j < UBS_C; ++j) {
        sum += (v_sq.e[i][j] + v_sq.e[j][i]) * in.b[j][c];
        if (c < 3) sum += s.p.e[i][j] * e[c < 3 ? c : 0][j];
      }
      if (c < 3)
        UBS_UNROLL for (int r = 0; r < 3; ++r) sum -= s.gain[r][i] * v_shrink.e[r][c < 3 ? c : 0];
      v.b[i][c] = sum;
    }
  return v;
}

#endif
#endif
