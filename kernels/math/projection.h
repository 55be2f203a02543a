// SPDX-License-Identifier: Apache-2.0
// Projects a sliced splat from the world to the image of a camera (method.md 2.5, 3.2). The forward function computes
// the mean and the support ellipse on the image plane. The backward function computes the gradients of the mean, of the
// frame M, and of the matrix K that shrinks the covariance (ellipse.h).
#pragma once

// CameraView is the camera of a view. It is the same for all splats of the view.
typedef struct {
  real rotation[3][3];  // world -> camera
  real centre[3];
  real fx, fy, cx, cy, width, height;
  real query[kCameraQueryMax];
  real near_plane, far_plane, eps2d;
} CameraView;

typedef struct {
  Vec3 p;               // conditional mean in the camera frame
  vreal x, y;           // the mean on the image [px]
  // True if the mean is too far outside the frustum (UBS_FRUSTUM_MARGIN), so that the slope in the linearisation is
  // clamped to the limit.
  vmask clamped_x, clamped_y;
  ImageMap j;           // T = J R_wc, the linearised projection from the world to the image plane
  Ellipse ellipse;
  vmask valid;
} Projected;

// Projects one splat. r is the conditional mean minus the camera centre, in the axes of the world. m and k are the
// matrices M and K of the conditional covariance V = M K M^T.
UBS_FN Projected project(CameraView cam, Vec3 r, FrameMap m, FrameMat k) {
  Projected out;
  UBS_UNROLL for (int i = 0; i < 3; ++i)
    out.p.e[i] = cam.rotation[i][0] * r.e[0] + cam.rotation[i][1] * r.e[1] + cam.rotation[i][2] * r.e[2];
  vmask in_range = (out.p.e[2] >= (vreal)(cam.near_plane)) & (out.p.e[2] <= (vreal)(cam.far_plane));
  vreal z = in_range ? out.p.e[2] : V(1.0);  // keeps culled lanes finite
  // OpenCL allows an error of 2.5 ulp in a division. An error of 3 ulp in 1/z moves a splat by 3e-3 pixels in an image
  // that is 8000 pixels wide. One Newton step removes this error. If divisions round correctly, the step does not
  // change the result; this was tested with all 2^23 mantissas.
  vreal inv_z = V(1.0) / z;
  inv_z = ubs_fma(inv_z, ubs_fma(-z, inv_z, V(1.0)), inv_z);
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

  // Rows of J = [[fx/z, 0, -fx tx/z^2], [0, fy/z, -fy ty/z^2]] times the rotation.
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    out.j.e[0][c] = cam.fx * inv_z * (cam.rotation[0][c] - slope_x * cam.rotation[2][c]);
    out.j.e[1][c] = cam.fy * inv_z * (cam.rotation[1][c] - slope_y * cam.rotation[2][c]);
  }
  out.ellipse = ellipse_on_image(out.j, m, k, cam.eps2d);
  Sym2 cov = out.ellipse.cov;
  // det = det(T V T^T) + eps (trace(T V T^T) + eps). If V is indefinite, the first term is negative. See UBS_DEFINITE.
  vreal least = (vreal)(UBS_DEFINITE * cam.eps2d) * (cov.a + (cov.c - cam.eps2d));
  out.valid = in_range & (out.ellipse.det > least) & (out.ellipse.det > V(0.0)) & (cov.a > V(0.0)) & (cov.c > V(0.0)) &
              ubs_finite(out.ellipse.det) & ubs_finite(out.x) & ubs_finite(out.y);
  return out;
}

// CameraVjp is the gradient of the camera (rows kCameraGrad* of kernels/layout.h). It is only used with
// UBS_CAMERA_GRAD.
typedef struct {
  vreal e[kCameraGrads];
} CameraVjp;

typedef struct {
  Vec3 r;  // gradient of the mean in the axes of the world
  FrameMap m;
  FrameVec along;  // see EllipseInputVjp
  FrameMat k;
#ifdef UBS_COUPLED_FACTOR
  ShrinkVjp shrink;
#endif
#ifdef UBS_CAMERA_GRAD
  CameraVjp camera;  // without the gradient through the query
#endif
} ProjectVjp;

#ifdef UBS_CAMERA_GRAD
// Returns the gradient of the camera. v_p is the gradient of the mean in the camera frame, and v_t the gradient of the
// linearised projection T = J R_wc.
// A rotation w of the camera about its centre, R -> (I + [w]) R, moves p by w x p and T by J [w] R. So v_w is p x v_p
// plus the skew part (B_21 - B_12, B_02 - B_20, B_10 - B_01) of B = J^T (v_T R^T). A translation u of the camera frame
// moves p by u.
// Row 0 of T is (fx / Z)(R_0 - s R_2) with the slope s = X/Z. If the slope is clamped to its limit, it has the form
// s = (a - cx) / fx + b / fx with constants a and b, so that ds/dcx = -1/fx and ds/dfx = -s/fx.
UBS_FN CameraVjp project_camera_vjp(CameraView cam, Projected f, Vec3 v_p, ImageMap v_t, vreal v_x, vreal v_y) {
  CameraVjp out;
  UBS_UNROLL for (int i = 0; i < kCameraGrads; ++i) out.e[i] = V(0.0);
  vreal z = f.valid ? f.p.e[2] : V(1.0), inv_z = V(1.0) / z, a[2][3], b[3][3];
  UBS_UNROLL for (int i = 0; i < 2; ++i)
    UBS_UNROLL for (int c = 0; c < 3; ++c)
      a[i][c] = v_t.e[i][0] * cam.rotation[c][0] + v_t.e[i][1] * cam.rotation[c][1] + v_t.e[i][2] * cam.rotation[c][2];
  vreal v[2], slope[2], mean[2];
  real focal[2];
  vmask clamped[2];
  v[0] = v_x, v[1] = v_y;
  focal[0] = cam.fx, focal[1] = cam.fy;
  clamped[0] = f.clamped_x, clamped[1] = f.clamped_y;
  UBS_UNROLL for (int i = 0; i < 2; ++i) {
    // Recovers s from T: (T_i R^T)_2 = -fx s / Z.
    vreal along = f.j.e[i][0] * cam.rotation[2][0] + f.j.e[i][1] * cam.rotation[2][1] + f.j.e[i][2] * cam.rotation[2][2];
    mean[i] = f.p.e[i] * inv_z;
    slope[i] = clamped[i] ? -along * z / focal[i] : mean[i];
    UBS_UNROLL for (int c = 0; c < 3; ++c)
      b[i][c] = focal[i] * inv_z * a[i][c];
  }
  UBS_UNROLL for (int c = 0; c < 3; ++c) b[2][c] = -(slope[0] * b[0][c] + slope[1] * b[1][c]);
  out.e[kCameraGradTurn] = f.p.e[1] * v_p.e[2] - f.p.e[2] * v_p.e[1] + (b[2][1] - b[1][2]);
  out.e[kCameraGradTurn + 1] = f.p.e[2] * v_p.e[0] - f.p.e[0] * v_p.e[2] + (b[0][2] - b[2][0]);
  out.e[kCameraGradTurn + 2] = f.p.e[0] * v_p.e[1] - f.p.e[1] * v_p.e[0] + (b[1][0] - b[0][1]);
  UBS_UNROLL for (int c = 0; c < 3; ++c) out.e[kCameraGradShift + c] = v_p.e[c];
  UBS_UNROLL for (int i = 0; i < 2; ++i) {
    vreal v_limit = clamped[i] ? -b[i][2] / focal[i] : V(0.0);  // gradient of the slope s, divided by the focal length
    out.e[kCameraGradFocal + i] = v[i] * mean[i] + inv_z * (a[i][i] - slope[i] * a[i][2]) - v_limit * slope[i];
    out.e[kCameraGradPrincipal + i] = v[i] - v_limit;
  }
  return out;
}
#endif

// Returns the gradients of the inputs of project(). v_x and v_y are the gradient of the mean on the image, and w is the
// gradient of the ellipse. v_compensation is the gradient of the blur compensation; it is only read with UBS_ANTIALIAS.
// v_depth is the gradient of the depth; it is only read with UBS_DEPTH_GRAD.
UBS_FN ProjectVjp project_vjp(CameraView cam, FrameMap m, FrameMat k, Projected f, vreal v_x, vreal v_y, EllipseVjp w,
                              vreal v_compensation, vreal v_depth) {
  ProjectVjp out;
  EllipseInputVjp e = ellipse_vjp(f.j, m, k, f.ellipse, w, cam.eps2d, v_compensation);
  out.m = e.m;
  out.along = e.along;
  out.k = e.k;
#ifdef UBS_COUPLED_FACTOR
  out.shrink = e.shrink;
#endif
  // J = f/Z [[1, 0, -X/Z], [0, 1, -Y/Z]], so X and Y affect only the third column, and only if the slopes are not
  // clamped. If the splat moves away from the camera, p -> (1 + e) p, the mean stays at the same place of the image,
  // and the ellipse shrinks as with M -> M / (1 + e). This is true whether or not the slopes are clamped. Therefore
  // p . v_p = -<v_M, M>. v_Z is computed from this equation instead of the sum of three terms, which nearly cancel for
  // large splats.
  vreal v_j02 = V(0.0), v_j12 = V(0.0), along = V(0.0);
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    v_j02 += e.t.e[0][c] * cam.rotation[2][c];
    v_j12 += e.t.e[1][c] * cam.rotation[2][c];
  }
  UBS_UNROLL for (int c = 0; c < UBS_F; ++c) along += e.along.e[c];
  vreal inv_z = V(1.0) / (f.valid ? f.p.e[2] : V(1.0));
  Vec3 v_p;
  v_p.e[0] = cam.fx * inv_z * (v_x - (f.clamped_x ? V(0.0) : inv_z * v_j02));
  v_p.e[1] = cam.fy * inv_z * (v_y - (f.clamped_y ? V(0.0) : inv_z * v_j12));
  v_p.e[2] = -inv_z * (f.p.e[0] * v_p.e[0] + f.p.e[1] * v_p.e[1] + along);
  if (UBS_DEPTH_GRAD) v_p.e[2] += v_depth;
#ifdef UBS_CAMERA_GRAD
  out.camera = project_camera_vjp(cam, f, v_p, e.t, v_x, v_y);
#endif
  UBS_UNROLL for (int c = 0; c < 3; ++c)
    out.r.e[c] = cam.rotation[0][c] * v_p.e[0] + cam.rotation[1][c] * v_p.e[1] + cam.rotation[2][c] * v_p.e[2];
  return out;
}
