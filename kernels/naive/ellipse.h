// SPDX-License-Identifier: Apache-2.0
// The textbook evaluation of math/ellipse.h, with its interface and for the published form only: V = M K M^T and
// B = T V T^T as products, det = ac - b^2, the conic B^-1, v_B = -Q v_Q Q, v_V = T^T v_B T. Only `ubs sweep` compiles
// it, to show where it breaks in single precision. Here ConicFactor holds the conic (Q00, Q01, Q11) itself and
// EllipseVjp its gradient (v_Q00, v_Q01 of both entries, v_Q11).
#ifndef UBS_NAIVE_ELLIPSE_H
#define UBS_NAIVE_ELLIPSE_H

typedef struct {
  vreal a, b, c;
} Sym2;

typedef struct {
  vreal e[2][3];
} ImageMap;

typedef struct {
  Sym2 cov;
  vreal det;
  Mat3 v;  // V, its upper triangle mirrored
} Ellipse;

UBS_FN Mat3 frame_product(FrameMap m, FrameMat k) {
  Mat3 mk;
  UBS_UNROLL for (int r = 0; r < 3; ++r)
    UBS_UNROLL for (int c = 0; c < 3; ++c)
      mk.e[r][c] = m.e[r][0] * k.e[0][c] + m.e[r][1] * k.e[1][c] + m.e[r][2] * k.e[2][c];
  return mk;
}

UBS_FN Ellipse ellipse_on_image(ImageMap t, FrameMap m, FrameMat k, real eps2d) {
  Ellipse out;
  Mat3 mk = frame_product(m, k);
  UBS_UNROLL for (int r = 0; r < 3; ++r)
    UBS_UNROLL for (int c = r; c < 3; ++c) {
      out.v.e[r][c] = mk.e[r][0] * m.e[c][0] + mk.e[r][1] * m.e[c][1] + mk.e[r][2] * m.e[c][2];
      out.v.e[c][r] = out.v.e[r][c];
    }
  ImageMap tv;
  UBS_UNROLL for (int i = 0; i < 2; ++i)
    UBS_UNROLL for (int c = 0; c < 3; ++c)
      tv.e[i][c] = t.e[i][0] * out.v.e[0][c] + t.e[i][1] * out.v.e[1][c] + t.e[i][2] * out.v.e[2][c];
  out.cov.a = tv.e[0][0] * t.e[0][0] + tv.e[0][1] * t.e[0][1] + tv.e[0][2] * t.e[0][2] + eps2d;
  out.cov.b = tv.e[0][0] * t.e[1][0] + tv.e[0][1] * t.e[1][1] + tv.e[0][2] * t.e[1][2];
  out.cov.c = tv.e[1][0] * t.e[1][0] + tv.e[1][1] * t.e[1][1] + tv.e[1][2] * t.e[1][2] + eps2d;
  out.det = out.cov.a * out.cov.c - out.cov.b * out.cov.b;
  return out;
}

typedef struct {
  vreal l00, l01, l11;
} ConicFactor;

UBS_FN ConicFactor conic_factor(Sym2 cov, vreal det) {
  ConicFactor q;
  q.l00 = cov.c / det;
  q.l01 = -cov.b / det;
  q.l11 = cov.a / det;
  return q;
}

typedef struct {
  vreal w00, w01, w11;
} EllipseVjp;

typedef struct {
  ImageMap t;
  FrameMap m;
  FrameVec along;
  FrameMat k;
} EllipseInputVjp;

UBS_FN EllipseInputVjp ellipse_vjp(ImageMap t, FrameMap m, FrameMat k, Ellipse f, EllipseVjp v_q, real eps2d,
                                   vreal v_compensation) {
  EllipseInputVjp out;
  (void)eps2d;
  (void)v_compensation;
  ConicFactor q = conic_factor(f.cov, f.det);
  vreal off = V(0.5) * v_q.w01;
  vreal m00 = q.l00 * v_q.w00 + q.l01 * off, m01 = q.l00 * off + q.l01 * v_q.w11;
  vreal m10 = q.l01 * v_q.w00 + q.l11 * off, m11 = q.l01 * off + q.l11 * v_q.w11;
  vreal b00 = -(m00 * q.l00 + m01 * q.l01), b01 = -(m00 * q.l01 + m01 * q.l11), b11 = -(m10 * q.l01 + m11 * q.l11);
  ImageMap w;  // v_B T
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    w.e[0][c] = b00 * t.e[0][c] + b01 * t.e[1][c];
    w.e[1][c] = b01 * t.e[0][c] + b11 * t.e[1][c];
  }
  // v_T = 2 v_B T V; v_M = H M K^T + H^T M K and v_K = M^T H M, H = v_V with its upper triangle for both halves.
  Mat3 h, mk = frame_product(m, k);
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    UBS_UNROLL for (int i = 0; i < 2; ++i)
      out.t.e[i][c] =
          V(2.0) * (w.e[i][0] * f.v.e[0][c] + w.e[i][1] * f.v.e[1][c] + w.e[i][2] * f.v.e[2][c]);
    UBS_UNROLL for (int r = 0; r < 3; ++r) {
      vreal v_v = t.e[0][r] * w.e[0][c] + t.e[1][r] * w.e[1][c];
      h.e[r][c] = c > r ? V(2.0) * v_v : c == r ? v_v : V(0.0);
    }
  }
  FrameMap hm;
  UBS_UNROLL for (int r = 0; r < 3; ++r)
    UBS_UNROLL for (int c = 0; c < 3; ++c)
      hm.e[r][c] = h.e[r][0] * m.e[0][c] + h.e[r][1] * m.e[1][c] + h.e[r][2] * m.e[2][c];
  UBS_UNROLL for (int r = 0; r < 3; ++r)
    UBS_UNROLL for (int c = 0; c < 3; ++c) {
      out.m.e[r][c] = V(0.0);
      UBS_UNROLL for (int j = 0; j < 3; ++j) out.m.e[r][c] += hm.e[r][j] * k.e[c][j] + h.e[j][r] * mk.e[j][c];
      out.k.e[r][c] = m.e[0][r] * hm.e[0][c] + m.e[1][r] * hm.e[1][c] + m.e[2][r] * hm.e[2][c];
    }
  UBS_UNROLL for (int c = 0; c < 3; ++c)
    out.along.e[c] = out.m.e[0][c] * m.e[0][c] + out.m.e[1][c] * m.e[1][c] + out.m.e[2][c] * m.e[2][c];
  return out;
}

#endif
