// SPDX-License-Identifier: Apache-2.0
// The functions of this file compute the support ellipse of a splat on the image (method.md 2.5, 3.2). The forward
// functions compute the covariance, the determinant and the conic of the ellipse from the frame M of the splat and the
// matrix K that shrinks its covariance (conditional.h). The backward functions compute the gradients of M, of K and of
// the linearised projection.
//
// With the linearised projection T = J R_wc the ellipse is B = T V T^T + eps I with V = M K M^T. (With `cov_mode
// upper`, the upper triangle of V is mirrored to the lower one.) For a thin ellipse, det B = ac - b^2 is far smaller
// than ac. Then the short axis can only be computed from V, B and their gradients as a difference of large numbers. In
// single precision, this already loses 1e-3 of the short axis if the axes have a ratio of 130 : 1. Therefore the code
// avoids differences of squares of the long axis:
// - The frame is projected as a factor, A = T M. By the formula of Cauchy and Binet, det(A K_s A^T) = n^T adj(K_s) n
//   with the minors n = a_0 x a_1 of A. For K = I this is a sum of squares.
// - K = K_s + K_a is split into its symmetric part K_s and its skew part K_a. K_a only has an effect with
//   `cov_mode upper`. It adds a symmetric matrix E, which is the projection of the mirrored triangle of M K_a M^T. For
//   2 x 2 matrices,
//     det(S + E + eps I) = det S + (s_a e_c + s_c e_a - 2 s_b e_b) + det E + eps (tr(S + E) + eps).
// - Gradients are passed in and out in the coordinates of the ellipse (EllipseVjp), in which the ellipse is the unit
//   circle.
// The remaining error is as large as the effect of half an ulp of the parameters
// (docs/results/2026-11-20-stability-sweeps.md).
#pragma once

enum {
  kShrinks = (UBS_C > 0) & !UBS_DIRECT,  // 1 if K is not the identity
  // 1 if K can have a skew part that has an effect. This requires `cov_mode upper` and several query dimensions, whose
  // weights (conditional.h) may differ.
  kSkewed = (UBS_C > 1) & !UBS_DIRECT & !UBS_WHITEN,
};

// Sym2 is a symmetric 2 x 2 matrix.
typedef struct {
  vreal a, b, c;  // [[a, b], [b, c]]
} Sym2;

// ImageMap is a linear map from the world or from the frame to the image plane.
typedef struct {
  vreal e[2][3];
} ImageMap;

typedef struct {
  vreal e[2][UBS_F];
} ImageFrame;

typedef struct {
  Sym2 cov;          // B [px^2]
  vreal det;         // determinant of B
  ImageFrame a;      // A = T M
  vreal skew[3];     // entries 01, 02 and 12 of M K_a M^T; only with kSkewed
  Sym2 mirrored;     // E; only with kSkewed
  // Only with UBS_ANTIALIAS: sqrt(det(B - eps2d I) / det B). The opacity is multiplied by this value, to compensate for
  // the area that the blur adds.
  vreal compensation;
} Ellipse;

// Returns entry (i, j) of K_s.
UBS_FN vreal shrink_symmetric(FrameMat k, int i, int j) {
  return i == j ? k.e[i][i] : V(0.5) * (k.e[i][j] + k.e[j][i]);
}
UBS_FN vreal shrink_skew(FrameMat k, int i, int j) { return k.e[i][j] - k.e[j][i]; }

// Returns A K_s.
UBS_FN ImageFrame frame_shrink(ImageFrame a, FrameMat k) {
  ImageFrame out = a;
  if (kShrinks) {
    UBS_UNROLL for (int i = 0; i < 2; ++i)
      UBS_UNROLL for (int c = 0; c < UBS_F; ++c) {
        out.e[i][c] = a.e[i][0] * shrink_symmetric(k, 0, c);
        UBS_UNROLL for (int r = 1; r < UBS_F; ++r) out.e[i][c] += a.e[i][r] * shrink_symmetric(k, r, c);
      }
  }
  return out;
}

// Returns a x b for two rows of length three.
UBS_FN Vec3 cross_rows(vreal a0, vreal a1, vreal a2, vreal b0, vreal b1, vreal b2) {
  Vec3 out;
  out.e[0] = a1 * b2 - a2 * b1;
  out.e[1] = a2 * b0 - a0 * b2;
  out.e[2] = a0 * b1 - a1 * b0;
  return out;
}

// Returns c a_0 - b a_1, which is c times the part of row 0 of A that is orthogonal to row 1. Entry j is computed from
// minors, as the sum over k of kappa_k (a_1k a_0j - a_0k a_1j), where kappa = K_s a_1 is row 1 of `ak`. This keeps the
// short axis, which the plain difference would lose.
UBS_FN FrameVec frame_rest(ImageFrame a, ImageFrame ak) {
  FrameVec out;
  UBS_UNROLL for (int j = 0; j < UBS_F; ++j) out.e[j] = V(0.0);
  UBS_UNROLL for (int j = 0; j < UBS_F; ++j)
    UBS_UNROLL for (int k = j + 1; k < UBS_F; ++k) {
      vreal minor = a.e[1][k] * a.e[0][j] - a.e[0][k] * a.e[1][j];
      out.e[j] += ak.e[1][k] * minor;
      out.e[k] -= ak.e[1][j] * minor;
    }
  return out;
}

// Returns det(A K_s A^T). For a frame with more than three columns (skew_nd), the formula of Cauchy and Binet would
// have too many minors. For such a frame, the determinant is computed as c (d K_s d^T), where d is the part of row 0
// that is orthogonal to row 1.
UBS_FN vreal frame_determinant(ImageFrame a, ImageFrame ak, FrameMat k, Sym2 s) {
  Vec3 minors = cross_rows(a.e[0][0], a.e[0][1], a.e[0][2], a.e[1][0], a.e[1][1], a.e[1][2]);
  vreal n0 = minors.e[0], n1 = minors.e[1], n2 = minors.e[2];
  if (!kShrinks) return n0 * n0 + n1 * n1 + n2 * n2;
  vreal k01 = shrink_symmetric(k, 0, 1), k02 = shrink_symmetric(k, 0, 2), k12 = shrink_symmetric(k, 1, 2);
  vreal adj00 = k.e[1][1] * k.e[2][2] - k12 * k12;
  vreal adj01 = k02 * k12 - k01 * k.e[2][2];
  vreal adj02 = k01 * k12 - k02 * k.e[1][1];
  vreal adj11 = k.e[0][0] * k.e[2][2] - k02 * k02;
  vreal adj12 = k01 * k02 - k.e[0][0] * k12;
  vreal adj22 = k.e[0][0] * k.e[1][1] - k01 * k01;
  if (UBS_F == 3)
    return n0 * (adj00 * n0 + V(2.0) * (adj01 * n1 + adj02 * n2)) + n1 * (adj11 * n1 + V(2.0) * adj12 * n2) +
           n2 * (n2 * adj22);  // with K = I, this order gives exactly the bits of n0^2 + n1^2 + n2^2
  FrameVec rest = frame_rest(a, ak);
  vreal square = V(0.0), inv_c = V(1.0) / (s.c > V(0.0) ? s.c : V(1.0));
  UBS_UNROLL for (int j = 0; j < UBS_F; ++j) {
    rest.e[j] = rest.e[j] * inv_c;
    vreal along = k.e[j][j] * rest.e[j];
    UBS_UNROLL for (int i = 0; i < j; ++i) along += V(2.0) * shrink_symmetric(k, i, j) * rest.e[i];
    square += along * rest.e[j];
  }
  return s.c > V(0.0) ? s.c * square : s.a * s.c - s.b * s.b;
}

// Returns entry (r, c) of M K_a M^T, computed as a sum over pairs of columns: an entry of K_a times a minor of M.
UBS_FN vreal frame_skew(FrameMap m, FrameMat k, int r, int c) {
  vreal sum = V(0.0);
  UBS_UNROLL for (int i = 0; i < UBS_F; ++i)
    UBS_UNROLL for (int j = i + 1; j < UBS_F; ++j)
      sum += V(0.5) * shrink_skew(k, i, j) * (m.e[r][i] * m.e[c][j] - m.e[r][j] * m.e[c][i]);
  return sum;
}

// Computes the ellipse on the image. t is the linearised projection T, m the frame M, and k the matrix K.
UBS_FN Ellipse ellipse_on_image(ImageMap t, FrameMap m, FrameMat k, real eps2d) {
  Ellipse out;
  ImageFrame a;
  UBS_UNROLL for (int i = 0; i < 2; ++i)
    UBS_UNROLL for (int c = 0; c < UBS_F; ++c)
      a.e[i][c] = t.e[i][0] * m.e[0][c] + t.e[i][1] * m.e[1][c] + t.e[i][2] * m.e[2][c];
  out.a = a;
  ImageFrame ak = frame_shrink(a, k);
  Sym2 s;
  s.a = ak.e[0][0] * a.e[0][0];
  s.b = ak.e[0][0] * a.e[1][0];
  s.c = ak.e[1][0] * a.e[1][0];
  UBS_UNROLL for (int c = 1; c < UBS_F; ++c) {
    s.a += ak.e[0][c] * a.e[0][c];
    s.b += ak.e[0][c] * a.e[1][c];
    s.c += ak.e[1][c] * a.e[1][c];
  }
  vreal sharp_det = frame_determinant(a, ak, k, s);
  if (kSkewed) {
    out.skew[0] = frame_skew(m, k, 0, 1);
    out.skew[1] = frame_skew(m, k, 0, 2);
    out.skew[2] = frame_skew(m, k, 1, 2);
    // E = T Z T^T, where Z is the symmetric matrix with a zero diagonal and the entries out.skew.
    Sym2 e;
    e.a = V(2.0) * (t.e[0][1] * (out.skew[0] * t.e[0][0] + out.skew[2] * t.e[0][2]) +
                    out.skew[1] * t.e[0][0] * t.e[0][2]);
    e.c = V(2.0) * (t.e[1][1] * (out.skew[0] * t.e[1][0] + out.skew[2] * t.e[1][2]) +
                    out.skew[1] * t.e[1][0] * t.e[1][2]);
    e.b = out.skew[0] * (t.e[0][0] * t.e[1][1] + t.e[0][1] * t.e[1][0]) +
          out.skew[1] * (t.e[0][0] * t.e[1][2] + t.e[0][2] * t.e[1][0]) +
          out.skew[2] * (t.e[0][1] * t.e[1][2] + t.e[0][2] * t.e[1][1]);
    sharp_det += (s.a * e.c + s.c * e.a - V(2.0) * s.b * e.b) + (e.a * e.c - e.b * e.b);
    s.a += e.a;
    s.b += e.b;
    s.c += e.c;
    out.mirrored = e;
  }
  out.cov.a = s.a + eps2d;
  out.cov.b = s.b;
  out.cov.c = s.c + eps2d;
  out.det = sharp_det + eps2d * (s.a + out.cov.c);
  if (UBS_ANTIALIAS) {
    vreal sharp = sharp_det / out.det;
    out.compensation = sharp > V(0.0) ? ubs_sqrt(sharp) : V(0.0);
    if (UBS_GAUSSIAN_ARRAYS) out.compensation = ubs_max(out.compensation, (vreal)(UBS_COMPENSATION_ARRAYS));
  }
  return out;
}

// ConicFactor is the triangular factor L of the conic Q = cov^-1, so that
//   Q = L^T L = [[l00^2, l00 l01], [l00 l01, l01^2 + l11^2]].
typedef struct {
  vreal l00, l01, l11;
} ConicFactor;

UBS_FN ConicFactor conic_factor(Sym2 cov, vreal det) {
  ConicFactor f;
  f.l00 = ubs_sqrt(cov.c / det);
  f.l01 = -(cov.b / cov.c) * f.l00;
  f.l11 = V(1.0) / ubs_sqrt(cov.c);
  return f;
}

// EllipseVjp is the gradient of the ellipse in its own coordinates. It is a symmetric matrix W. If B changes by dB, the
// loss changes by the sum of the products of the entries of W and of L dB L^T, where L is the factor of the conic. So
// v_B = L^T W L and v_Q = -L^-1 W L^-T. The entries of W stay moderate even for very thin ellipses, whereas in v_B and
// v_Q the short axis is lost in the rounding errors of the long axis.
typedef struct {
  vreal w00, w01, w11;
} EllipseVjp;

typedef struct {
  ImageMap t;
  FrameMap m;
  // Entry c is the sum over r of v_M_rc M_rc, which is the gradient with respect to a stretch of column c of M. It is
  // computed separately, because for a long column the terms of this sum would nearly cancel.
  FrameVec along;
  FrameMat k;
#ifdef UBS_COUPLED_FACTOR
  ShrinkVjp shrink;  // v_K, stored as factors
#endif
} EllipseInputVjp;

// Adds the gradient of the blur compensation to w. rho^2 = det(B - eps I) / det B, so v_B += v_rho / (2 rho)
// ((1 - rho^2) Q - eps det(Q) I) (method.md 3.2), with Q = L^T L and det(Q) I = L^T adj(L L^T) L.
UBS_FN EllipseVjp compensation_vjp(EllipseVjp w, ConicFactor l, vreal compensation, real eps2d, vreal v_compensation) {
  if (UBS_GAUSSIAN_ARRAYS)
    v_compensation = compensation > (vreal)(UBS_COMPENSATION_ARRAYS) ? v_compensation : V(0.0);
  vreal rho = compensation > (vreal)(UBS_COMPENSATION_MIN) ? compensation : (vreal)(UBS_COMPENSATION_MIN);
  vreal half_v = V(0.5) * v_compensation / rho;
  vreal sharpened = half_v * (V(1.0) - compensation * compensation);
  vreal blurred = half_v * eps2d;
  w.w00 += sharpened - blurred * l.l11 * l.l11;
  w.w01 += blurred * l.l01 * l.l11;
  w.w11 += sharpened - blurred * (l.l00 * l.l00 + l.l01 * l.l01);
  return w;
}

// Returns the gradients of T, M and K. w is the gradient of the ellipse. v_compensation is the gradient of the blur
// compensation; it is only read with UBS_ANTIALIAS.
UBS_FN EllipseInputVjp ellipse_vjp(ImageMap image, FrameMap m, FrameMat k, Ellipse f, EllipseVjp w, real eps2d,
                                   vreal v_compensation) {
  EllipseInputVjp out;
  ConicFactor l = conic_factor(f.cov, f.det);
  if (UBS_ANTIALIAS) w = compensation_vjp(w, l, f.compensation, eps2d, v_compensation);
  // H = L A is the frame in the coordinates of the ellipse: v_K = H^T W H, v_A = L^T G with G = 2 W H K_s.
  // `lt` is L T, the axes of the world in these coordinates: v_M = (L T)^T G, and v_T = L^T Y with Y = G M^T.
  ImageFrame wh;
  vreal h[2][UBS_F];
  ImageMap lt;
  // Row 0 of L is l00 (1, -b/c), so the terms of row 0 of H = L A, l00 a_0 + l01 a_1, would nearly cancel along the
  // long axis. With kappa = K_s a_1, this row is l00 / c times
  //   c a_0 - b a_1 = kappa x (a_0 x a_1) + eps a_0 + e_c a_0 - e_b a_1.
  // If the frame has more than three columns, frame_rest() replaces the first term. Row 0 of L T is computed in the
  // same way, with the first term mu x (t_0 x t_1), where mu = M kappa.
  ImageFrame ak = frame_shrink(f.a, k);
  Vec3 ray = cross_rows(image.e[0][0], image.e[0][1], image.e[0][2], image.e[1][0], image.e[1][1], image.e[1][2]);
  vreal mu[3];
  FrameVec n;
  if (UBS_F == 3) {
    UBS_UNROLL for (int r = 0; r < 3; ++r)
      mu[r] = m.e[r][0] * ak.e[1][0] + m.e[r][1] * ak.e[1][1] + m.e[r][2] * ak.e[1][2];
    Vec3 minors = cross_rows(f.a.e[0][0], f.a.e[0][1], f.a.e[0][2], f.a.e[1][0], f.a.e[1][1], f.a.e[1][2]);
    minors = cross_rows(ak.e[1][0], ak.e[1][1], ak.e[1][2], minors.e[0], minors.e[1], minors.e[2]);
    UBS_UNROLL for (int c = 0; c < 3; ++c) n.e[c] = minors.e[c];
  } else {
    n = frame_rest(f.a, ak);
    UBS_UNROLL for (int r = 0; r < 3; ++r) {
      mu[r] = m.e[r][0] * ak.e[1][0];
      UBS_UNROLL for (int c = 1; c < UBS_F; ++c) mu[r] += m.e[r][c] * ak.e[1][c];
    }
  }
  ray = cross_rows(mu[0], mu[1], mu[2], ray.e[0], ray.e[1], ray.e[2]);
  vreal l00_c = l.l00 / f.cov.c, blur = (vreal)(eps2d);
  if (kSkewed) blur += f.mirrored.c;
  UBS_UNROLL for (int c = 0; c < UBS_F; ++c) {
    h[0][c] = n.e[c] + blur * f.a.e[0][c];
    if (kSkewed) h[0][c] -= f.mirrored.b * f.a.e[1][c];
    h[0][c] *= l00_c;
  }
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    lt.e[0][c] = ray.e[c] + blur * image.e[0][c];
    if (kSkewed) lt.e[0][c] -= f.mirrored.b * image.e[1][c];
    lt.e[0][c] *= l00_c;
  }
  UBS_UNROLL for (int c = 0; c < UBS_F; ++c) h[1][c] = l.l11 * f.a.e[1][c];
  UBS_UNROLL for (int c = 0; c < 3; ++c) lt.e[1][c] = l.l11 * image.e[1][c];
  UBS_UNROLL for (int c = 0; c < UBS_F; ++c) {
    wh.e[0][c] = w.w00 * h[0][c] + w.w01 * h[1][c];
    wh.e[1][c] = w.w01 * h[0][c] + w.w11 * h[1][c];
  }
  UBS_UNROLL for (int r = 0; r < UBS_F; ++r)
    UBS_UNROLL for (int c = 0; c < UBS_F; ++c) out.k.e[r][c] = h[0][r] * wh.e[0][c] + h[1][r] * wh.e[1][c];
#ifdef UBS_COUPLED_FACTOR
  UBS_UNROLL for (int i = 0; i < 2; ++i)
    UBS_UNROLL for (int c = 0; c < 3; ++c) {
      out.shrink.h[i][c] = h[i][c];
      out.shrink.t[i][c] = lt.e[i][c];
    }
  out.shrink.w00 = w.w00;
  out.shrink.w01 = w.w01;
  out.shrink.w11 = w.w11;
  out.shrink.turn[0] = out.shrink.turn[1] = out.shrink.turn[2] = V(0.0);
#endif
  ImageFrame g = frame_shrink(wh, k);
  UBS_UNROLL for (int c = 0; c < UBS_F; ++c)
    out.along.e[c] = V(2.0) * (g.e[0][c] * h[0][c] + g.e[1][c] * h[1][c]);
  vreal t[2][3], y[2][3];
  UBS_UNROLL for (int r = 0; r < 3; ++r) {
    t[0][r] = V(2.0) * lt.e[0][r];
    t[1][r] = V(2.0) * lt.e[1][r];
    UBS_UNROLL for (int c = 0; c < UBS_F; ++c) out.m.e[r][c] = t[0][r] * g.e[0][c] + t[1][r] * g.e[1][c];
    UBS_UNROLL for (int i = 0; i < 2; ++i) {
      y[i][r] = g.e[i][0] * m.e[r][0];
      UBS_UNROLL for (int c = 1; c < UBS_F; ++c) y[i][r] += g.e[i][c] * m.e[r][c];
      y[i][r] = V(2.0) * y[i][r];
    }
  }
  if (kSkewed) {
    // z contains the entries of M K_a M^T, and t_i is column i of T. E = sum_{i<j} z_ij (t_i t_j^T + t_j t_i^T), so
    // v_z_ij = 2 (L t_i)^T W (L t_j), and 2 v_B t_j z_ij is added to the gradient of t_i.
    // With the skew matrix S = v_z / 2, v_M -= 2 S M K_a and v_K += M^T S M.
    vreal wt[2][3], s01, s02, s12;
    UBS_UNROLL for (int r = 0; r < 3; ++r) {
      wt[0][r] = w.w00 * t[0][r] + w.w01 * t[1][r];
      wt[1][r] = w.w01 * t[0][r] + w.w11 * t[1][r];
    }
    UBS_UNROLL for (int i = 0; i < 2; ++i) {
      y[i][0] += f.skew[0] * wt[i][1] + f.skew[1] * wt[i][2];
      y[i][1] += f.skew[0] * wt[i][0] + f.skew[2] * wt[i][2];
      y[i][2] += f.skew[1] * wt[i][0] + f.skew[2] * wt[i][1];
    }
    s01 = V(0.25) * (t[0][0] * wt[0][1] + t[1][0] * wt[1][1]);  // the variable t contains 2 L T
    s02 = V(0.25) * (t[0][0] * wt[0][2] + t[1][0] * wt[1][2]);
    s12 = V(0.25) * (t[0][1] * wt[0][2] + t[1][1] * wt[1][2]);
#ifdef UBS_COUPLED_FACTOR
    out.shrink.turn[0] = s01;
    out.shrink.turn[1] = s02;
    out.shrink.turn[2] = s12;
#endif
    vreal sm[3][UBS_F];
    UBS_UNROLL for (int c = 0; c < UBS_F; ++c) {
      sm[0][c] = s01 * m.e[1][c] + s02 * m.e[2][c];
      sm[1][c] = s12 * m.e[2][c] - s01 * m.e[0][c];
      sm[2][c] = -(s02 * m.e[0][c] + s12 * m.e[1][c]);
    }
    UBS_UNROLL for (int c = 0; c < UBS_F; ++c) {
      UBS_UNROLL for (int r = 0; r < 3; ++r)
        UBS_UNROLL for (int i = 0; i < UBS_F; ++i)
          if (i != c) {
            vreal part = sm[r][i] * shrink_skew(k, c, i);
            out.m.e[r][c] += part;
            out.along.e[c] += part * m.e[r][c];
          }
      UBS_UNROLL for (int r = 0; r < c; ++r) {
        vreal sum = m.e[0][r] * sm[0][c] + m.e[1][r] * sm[1][c] + m.e[2][r] * sm[2][c];
        out.k.e[r][c] += sum;
        out.k.e[c][r] -= sum;
      }
    }
  }
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    out.t.e[0][c] = l.l00 * y[0][c];
    out.t.e[1][c] = l.l01 * y[0][c] + l.l11 * y[1][c];
  }
  return out;
}
