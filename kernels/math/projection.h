// SPDX-License-Identifier: Apache-2.0
// World -> camera -> image of a conditional splat (method.md 2.5, 3.2): mean and support ellipse on the
// image plane, its conic, and the gradients back to the mean and the 3 x 3 covariance.
#ifndef UBS_MATH_PROJECTION_H
#define UBS_MATH_PROJECTION_H

// Uniform over all splats of a view.
typedef struct {
  real rotation[3][3];  // world -> camera
  real centre[3];
  real fx, fy, cx, cy, width, height;
  real query[UBS_CAM_QUERY_MAX];
  real near_plane, far_plane, eps2d;
} CameraView;

// Symmetric 2 x 2.
typedef struct {
  vreal a, b, c;  // [[a, b], [b, c]]
} Sym2;

typedef struct {
  Vec3 p;               // conditional mean in the camera frame
  vreal x, y;           // its image [px]
  vreal tx, ty;         // p.x, p.y clamped to the frustum, where the linearisation is taken
  vmask clamped_x, clamped_y;
  vreal j[2][3];        // J R_wc: image plane by world
  Sym2 cov;             // support ellipse on the image plus eps2d [px^2]
  vreal det;
#if UBS_ANTIALIAS
  vreal compensation;   // sqrt(det without eps2d / det): the opacity that the blur adds is taken away
#endif
  vmask valid;
} Projected;

// r: conditional mean minus camera centre (world axes); v: conditional covariance, symmetric.
UBS_FN Projected project(CameraView cam, Vec3 r, Mat3 v) {
  Projected out;
  UBS_UNROLL for (int i = 0; i < 3; ++i)
    out.p.e[i] = cam.rotation[i][0] * r.e[0] + cam.rotation[i][1] * r.e[1] + cam.rotation[i][2] * r.e[2];
  vmask in_range = (out.p.e[2] >= (vreal)(cam.near_plane)) & (out.p.e[2] <= (vreal)(cam.far_plane));
  vreal z = in_range ? out.p.e[2] : V(1.0);  // keeps culled lanes finite
  vreal inv_z = V(1.0) / z;
  vreal slope_x = out.p.e[0] * inv_z;
  vreal slope_y = out.p.e[1] * inv_z;
  out.x = cam.fx * slope_x + cam.cx;
  out.y = cam.fy * slope_y + cam.cy;

  real margin_x = UBS_FRUSTUM_MARGIN * R(0.5) * cam.width / cam.fx;
  real margin_y = UBS_FRUSTUM_MARGIN * R(0.5) * cam.height / cam.fy;
  vreal right = (vreal)((cam.width - cam.cx) / cam.fx + margin_x);
  vreal left = (vreal)(-(cam.cx / cam.fx + margin_x));
  vreal bottom = (vreal)((cam.height - cam.cy) / cam.fy + margin_y);
  vreal top = (vreal)(-(cam.cy / cam.fy + margin_y));
  out.clamped_x = (slope_x < left) | (slope_x > right);
  out.clamped_y = (slope_y < top) | (slope_y > bottom);
  slope_x = slope_x < left ? left : slope_x;
  slope_x = slope_x > right ? right : slope_x;
  slope_y = slope_y < top ? top : slope_y;
  slope_y = slope_y > bottom ? bottom : slope_y;
  out.tx = z * slope_x;
  out.ty = z * slope_y;

  // Rows of J = [[fx/z, 0, -fx tx/z^2], [0, fy/z, -fy ty/z^2]] times the rotation.
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    out.j[0][c] = cam.fx * inv_z * (cam.rotation[0][c] - slope_x * cam.rotation[2][c]);
    out.j[1][c] = cam.fy * inv_z * (cam.rotation[1][c] - slope_y * cam.rotation[2][c]);
  }
  vreal t0[3], t1[3];
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    t0[c] = out.j[0][0] * v.e[0][c] + out.j[0][1] * v.e[1][c] + out.j[0][2] * v.e[2][c];
    t1[c] = out.j[1][0] * v.e[0][c] + out.j[1][1] * v.e[1][c] + out.j[1][2] * v.e[2][c];
  }
  out.cov.a = t0[0] * out.j[0][0] + t0[1] * out.j[0][1] + t0[2] * out.j[0][2] + cam.eps2d;
  out.cov.b = t0[0] * out.j[1][0] + t0[1] * out.j[1][1] + t0[2] * out.j[1][2];
  out.cov.c = t1[0] * out.j[1][0] + t1[1] * out.j[1][1] + t1[2] * out.j[1][2] + cam.eps2d;
  out.det = out.cov.a * out.cov.c - out.cov.b * out.cov.b;
#if UBS_ANTIALIAS
  vreal sharp_a = t0[0] * out.j[0][0] + t0[1] * out.j[0][1] + t0[2] * out.j[0][2];
  vreal sharp_c = t1[0] * out.j[1][0] + t1[1] * out.j[1][1] + t1[2] * out.j[1][2];
  vreal sharp = (sharp_a * sharp_c - out.cov.b * out.cov.b) / out.det;
  out.compensation = sharp > V(0.0) ? ubs_sqrt(sharp) : V(0.0);
#endif
  out.valid = in_range & (out.det > V(0.0)) & (out.cov.a > V(0.0)) & (out.cov.c > V(0.0)) & ubs_finite(out.det) &
              ubs_finite(out.x) & ubs_finite(out.y);
  return out;
}

// Factor of the conic Q = cov^-1: Q = [[l00^2, l00 l01], [., l01^2 + l11^2]].
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

typedef struct {
  Vec3 r;  // world axes
  Mat3 v;  // symmetric, off-diagonals NOT doubled: dL = sum over all 9 entries
} ProjectVjp;

// v_x, v_y: gradient of the image mean; v_q: gradient of the conic, b counting both off-diagonals;
// v_compensation: of the compensation (not looked at without it).
UBS_FN ProjectVjp project_vjp(CameraView cam, Mat3 v, Projected f, vreal v_x, vreal v_y, Sym2 v_q,
                              vreal v_compensation) {
  ProjectVjp out;
  // v_B = -Q v_Q Q, with Q = [[c, -b], [-b, a]] / det.
  vreal qa = f.cov.c / f.det, qb = -f.cov.b / f.det, qc = f.cov.a / f.det;
  vreal off = V(0.5) * v_q.b;
  vreal m00 = qa * v_q.a + qb * off, m01 = qa * off + qb * v_q.c;
  vreal m10 = qb * v_q.a + qc * off, m11 = qb * off + qc * v_q.c;
  vreal s00 = -(m00 * qa + m01 * qb);
  vreal s01 = -(m00 * qb + m01 * qc);
  vreal s11 = -(m10 * qb + m11 * qc);
#if UBS_ANTIALIAS
  // rho^2 = det(B - eps I) / det B: v_B += v_rho / (2 rho) ((1 - rho^2) Q - eps det(Q) I) (method.md 3.2).
  vreal rho = f.compensation > (vreal)(UBS_COMPENSATION_MIN) ? f.compensation : (vreal)(UBS_COMPENSATION_MIN);
  vreal half_v = V(0.5) * v_compensation / rho;
  vreal sharpened = half_v * (V(1.0) - f.compensation * f.compensation);
  vreal diagonal = half_v * cam.eps2d / f.det;
  s00 += sharpened * qa - diagonal;
  s01 += sharpened * qb;
  s11 += sharpened * qc - diagonal;
#else
  (void)v_compensation;
#endif

  // v_V = j^T v_B j and v_j = 2 v_B j V.
  vreal w0[3], w1[3];  // v_B j
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    w0[c] = s00 * f.j[0][c] + s01 * f.j[1][c];
    w1[c] = s01 * f.j[0][c] + s11 * f.j[1][c];
  }
  vreal v_j0[3], v_j1[3];
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    UBS_UNROLL for (int k = 0; k < 3; ++k) out.v.e[k][c] = f.j[0][k] * w0[c] + f.j[1][k] * w1[c];
    v_j0[c] = V(2.0) * (w0[0] * v.e[0][c] + w0[1] * v.e[1][c] + w0[2] * v.e[2][c]);
    v_j1[c] = V(2.0) * (w1[0] * v.e[0][c] + w1[1] * v.e[1][c] + w1[2] * v.e[2][c]);
  }
  // Back through the rotation: v_J = v_j R^T; only four entries of J vary.
  vreal v_j00 = V(0.0), v_j02 = V(0.0), v_j11 = V(0.0), v_j12 = V(0.0);
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    v_j00 += v_j0[c] * cam.rotation[0][c];
    v_j02 += v_j0[c] * cam.rotation[2][c];
    v_j11 += v_j1[c] * cam.rotation[1][c];
    v_j12 += v_j1[c] * cam.rotation[2][c];
  }
  vreal inv_z = V(1.0) / (f.valid ? f.p.e[2] : V(1.0));
  vreal inv_z2 = inv_z * inv_z;
  vreal fx2 = cam.fx * inv_z2, fy2 = cam.fy * inv_z2;
  // Inside the frustum J02 = -fx X/Z^2 varies with X and Z; clamped, J02 = -fx limit/Z with Z alone.
  Vec3 v_p;
  v_p.e[0] = cam.fx * inv_z * v_x - (f.clamped_x ? V(0.0) : fx2 * v_j02);
  v_p.e[1] = cam.fy * inv_z * v_y - (f.clamped_y ? V(0.0) : fy2 * v_j12);
  v_p.e[2] = -inv_z2 * (cam.fx * f.p.e[0] * v_x + cam.fy * f.p.e[1] * v_y) - fx2 * v_j00 - fy2 * v_j11 +
             (f.clamped_x ? V(1.0) : V(2.0)) * fx2 * inv_z * f.tx * v_j02 +
             (f.clamped_y ? V(1.0) : V(2.0)) * fy2 * inv_z * f.ty * v_j12;
  UBS_UNROLL for (int c = 0; c < 3; ++c)
    out.r.e[c] = cam.rotation[0][c] * v_p.e[0] + cam.rotation[1][c] * v_p.e[1] + cam.rotation[2][c] * v_p.e[2];
  return out;
}

#endif
