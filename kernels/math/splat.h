// SPDX-License-Identifier: Apache-2.0
// The whole way of one splat in one view: raw parameters -> what the rasteriser needs, and back.
// Composes covariance.h, conditional.h and projection.h; N is fixed by UBS_N (kernels/layout.h).
#ifndef UBS_MATH_SPLAT_H
#define UBS_MATH_SPLAT_H

typedef struct {
  vreal e[UBS_PARAMS];  // rows as in kernels/layout.h
} SplatRaw;

typedef struct {
  vreal x, y, depth;     // [px], [px], world units
  ConicFactor conic;
  vreal opacity, beta;   // conditioned opacity; exponent of the spatial kernel
  vreal r, g, b;
  vreal hx, hy;          // half extents of the footprint [px], with the rounding margin
  vmask valid;           // to be drawn (if its footprint meets the image)
} SplatImage;

// Intermediate values that forward and backward share.
typedef struct {
  SpatialFrame frame;
  Vec3 to_splat;   // mu_x - camera centre
  vreal rho;
  Vec3 direction;
#if UBS_C > 0
  SliceInput slice_in;
  Slice slice;
#endif
  Conditional conditional;
  Mat3 mk;         // M K
  Mat3 v;          // conditional covariance as used: symmetric
  vreal opacity;   // base opacity o
  Projected projected;
} SplatState;

UBS_FN SplatState splat_state(CameraView cam, SplatRaw raw) {
  SplatState s;
  s.frame = spatial_frame(raw.e[UBS_P_L], raw.e[UBS_P_L + 1], raw.e[UBS_P_L + 2], raw.e[UBS_P_SCALE],
                          raw.e[UBS_P_SCALE + 1], raw.e[UBS_P_SCALE + 2]);
  UBS_UNROLL for (int c = 0; c < 3; ++c) s.to_splat.e[c] = raw.e[UBS_P_XYZ + c] - cam.centre[c];
  s.rho = ubs_sqrt(s.to_splat.e[0] * s.to_splat.e[0] + s.to_splat.e[1] * s.to_splat.e[1] +
                   s.to_splat.e[2] * s.to_splat.e[2]);
  s.rho = s.rho > (vreal)(UBS_RHO_MIN) ? s.rho : (vreal)(UBS_RHO_MIN);
  UBS_UNROLL for (int c = 0; c < 3; ++c) s.direction.e[c] = s.to_splat.e[c] / s.rho;
  s.opacity = ubs_sigmoid(raw.e[UBS_P_OPACITY]);

#if UBS_C > 0
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    int row = i + 3;
    UBS_UNROLL for (int j = 0; j < 3 + UBS_C; ++j)
      s.slice_in.b[i][j] = j < row ? raw.e[UBS_P_L + UBS_TRIANGLE(row, j < row ? j : 0)] : V(0.0);
    s.slice_in.b[i][row] = ubs_softplus(raw.e[UBS_P_SCALE + row]);
    vreal query = (UBS_HAS_DIRECTION && i < 3) ? s.direction.e[i < 3 ? i : 0]
                                               : (vreal)(cam.query[i >= UBS_FIRST_VALUE ? i - UBS_FIRST_VALUE : 0]);
    s.slice_in.x.e[i] = query - raw.e[UBS_P_MEAN + i];
    vreal growth = ubs_exp(raw.e[UBS_P_BETA + 1 + i]);
    s.slice_in.exponent.e[i] = V(4.0) * growth;
    s.slice_in.weight.e[i] = growth < V(1.0) ? growth : V(1.0);
  }
  s.slice = slice_forward(s.slice_in);
  s.conditional = slice_result(s.slice_in, s.slice);
#else
  s.conditional.log_factor = V(0.0);
  UBS_UNROLL for (int r = 0; r < 3; ++r) {
    s.conditional.offset.e[r] = V(0.0);
    UBS_UNROLL for (int c = 0; c < 3; ++c) s.conditional.shrink.e[r][c] = r == c ? V(1.0) : V(0.0);
  }
#endif

  UBS_UNROLL for (int r = 0; r < 3; ++r)
    UBS_UNROLL for (int c = 0; c < 3; ++c)
      s.mk.e[r][c] = s.frame.m.e[r][0] * s.conditional.shrink.e[0][c] +
                     s.frame.m.e[r][1] * s.conditional.shrink.e[1][c] +
                     s.frame.m.e[r][2] * s.conditional.shrink.e[2][c];
  // V = M K M^T is not symmetric in general; the published rule keeps its upper triangle (2.3, `upper`).
  UBS_UNROLL for (int r = 0; r < 3; ++r)
    UBS_UNROLL for (int c = r; c < 3; ++c) {
      s.v.e[r][c] = s.mk.e[r][0] * s.frame.m.e[c][0] + s.mk.e[r][1] * s.frame.m.e[c][1] +
                    s.mk.e[r][2] * s.frame.m.e[c][2];
      s.v.e[c][r] = s.v.e[r][c];
    }
  // Relative to the camera from the start: nothing is lost for scenes far from the origin.
  Vec3 r;
  UBS_UNROLL for (int i = 0; i < 3; ++i)
    r.e[i] = s.to_splat.e[i] + s.frame.m.e[i][0] * s.conditional.offset.e[0] +
             s.frame.m.e[i][1] * s.conditional.offset.e[1] + s.frame.m.e[i][2] * s.conditional.offset.e[2];
  s.projected = project(cam, r, s.v);
  return s;
}

UBS_FN SplatImage splat_image(SplatRaw raw, SplatState s) {
  SplatImage out;
  out.x = s.projected.x;
  out.y = s.projected.y;
  out.depth = s.projected.p.e[2];
  out.conic = conic_factor(s.projected.cov, s.projected.det);
  out.opacity = s.opacity * ubs_exp(s.conditional.log_factor);
  out.beta = V(4.0) * ubs_exp(raw.e[UBS_P_BETA]);
  out.r = raw.e[UBS_P_RGB];
  out.g = raw.e[UBS_P_RGB + 1];
  out.b = raw.e[UBS_P_RGB + 2];
  out.hx = ubs_sqrt(s.projected.cov.a) + (vreal)(UBS_FOOTPRINT_MARGIN);
  out.hy = ubs_sqrt(s.projected.cov.c) + (vreal)(UBS_FOOTPRINT_MARGIN);
  // An opacity of exactly zero (underflow far from the splat's query) draws nothing and has no gradient.
  out.valid = s.projected.valid & (out.opacity > V(0.0)) & ubs_finite(out.beta) & ubs_finite(out.conic.l00) &
              ubs_finite(out.conic.l01) & ubs_finite(out.conic.l11) & ubs_finite(out.r + out.g + out.b);
  return out;
}

// Gradient of the loss to what the rasteriser used.
typedef struct {
  vreal x, y;
  Sym2 conic;  // b counts both off-diagonals
  vreal opacity, beta, r, g, b;
} SplatImageVjp;

UBS_FN SplatRaw splat_vjp(CameraView cam, SplatRaw raw, SplatImageVjp v) {
  SplatState s = splat_state(cam, raw);
  SplatRaw out;
  out.e[UBS_P_RGB] = v.r;
  out.e[UBS_P_RGB + 1] = v.g;
  out.e[UBS_P_RGB + 2] = v.b;
  out.e[UBS_P_BETA] = v.beta * V(4.0) * ubs_exp(raw.e[UBS_P_BETA]);  // d 4exp(b)/db is itself
  vreal factor = ubs_exp(s.conditional.log_factor);
  out.e[UBS_P_OPACITY] = v.opacity * factor * s.opacity * ubs_sigmoid(-raw.e[UBS_P_OPACITY]);

  ProjectVjp p = project_vjp(cam, s.v, s.projected, v.x, v.y, v.conic);
  // The upper triangle of V stands for both halves: H = its gradient as of a general matrix (3.3).
  Mat3 h;
  UBS_UNROLL for (int r = 0; r < 3; ++r)
    UBS_UNROLL for (int c = 0; c < 3; ++c) h.e[r][c] = c > r ? V(2.0) * p.v.e[r][c] : c == r ? p.v.e[r][c] : V(0.0);

  // mu_c = mu_x + M k, V = M K M^T:
  //   v_k = M^T v_mu, v_K = M^T H M, v_M = v_mu k^T + H M K^T + H^T M K.
  Mat3 hm, v_m;
  UBS_UNROLL for (int r = 0; r < 3; ++r)
    UBS_UNROLL for (int c = 0; c < 3; ++c)
      hm.e[r][c] = h.e[r][0] * s.frame.m.e[0][c] + h.e[r][1] * s.frame.m.e[1][c] + h.e[r][2] * s.frame.m.e[2][c];
  UBS_UNROLL for (int r = 0; r < 3; ++r)
    UBS_UNROLL for (int c = 0; c < 3; ++c) {
      vreal sum = p.r.e[r] * s.conditional.offset.e[c];
      UBS_UNROLL for (int j = 0; j < 3; ++j) sum += hm.e[r][j] * s.conditional.shrink.e[c][j] + h.e[j][r] * s.mk.e[j][c];
      v_m.e[r][c] = sum;
    }

  Vec3 raw_scale;
  UBS_UNROLL for (int c = 0; c < 3; ++c) raw_scale.e[c] = raw.e[UBS_P_SCALE + c];
  SpatialFrameVjp f = spatial_frame_vjp(s.frame, raw_scale, v_m);
  out.e[UBS_P_L] = f.a0;
  out.e[UBS_P_L + 1] = f.a1;
  out.e[UBS_P_L + 2] = f.a2;
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    out.e[UBS_P_SCALE + c] = f.raw_scale.e[c];
    out.e[UBS_P_XYZ + c] = p.r.e[c];
  }

#if UBS_C > 0
  Vec3 v_k;
  Mat3 v_shrink;
  UBS_UNROLL for (int r = 0; r < 3; ++r) {
    v_k.e[r] = s.frame.m.e[0][r] * p.r.e[0] + s.frame.m.e[1][r] * p.r.e[1] + s.frame.m.e[2][r] * p.r.e[2];
    UBS_UNROLL for (int c = 0; c < 3; ++c)
      v_shrink.e[r][c] =
          s.frame.m.e[0][r] * hm.e[0][c] + s.frame.m.e[1][r] * hm.e[1][c] + s.frame.m.e[2][r] * hm.e[2][c];
  }
  SliceVjp q = slice_vjp(s.slice_in, s.slice, v_k, v_shrink, v.opacity * s.opacity * factor);
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    int row = i + 3;
    UBS_UNROLL for (int j = 0; j < 3 + UBS_C; ++j)
      if (j < row) out.e[UBS_P_L + UBS_TRIANGLE(row, j)] = q.b[i][j];
    out.e[UBS_P_SCALE + row] = q.b[i][row] * ubs_sigmoid(raw.e[UBS_P_SCALE + row]);
    out.e[UBS_P_MEAN + i] = -q.x.e[i];
    // Strict b < 0: at the saturation point of the weight the published slope is 0.
    vreal bq = raw.e[UBS_P_BETA + 1 + i];
    vreal through_weight = bq < V(0.0) ? s.slice_in.weight.e[i] * q.weight.e[i] : V(0.0);
    out.e[UBS_P_BETA + 1 + i] = s.slice_in.exponent.e[i] * q.exponent.e[i] + through_weight;
  }
#ifdef UBS_QUERY_GRAD
#if UBS_HAS_DIRECTION
  // d = w / |w|: v_w = (I - d d^T) v_d / |w|.
  vreal along = q.x.e[0] * s.direction.e[0] + q.x.e[1] * s.direction.e[1] + q.x.e[2] * s.direction.e[2];
  UBS_UNROLL for (int c = 0; c < 3; ++c) out.e[UBS_P_XYZ + c] += (q.x.e[c] - along * s.direction.e[c]) / s.rho;
#endif
#endif
#endif
  return out;
}

#endif
