// SPDX-License-Identifier: Apache-2.0
// splat.h contains all computations for one splat in one view. splat_image() computes, from the raw parameters, the
// values that the rasteriser needs. splat_vjp() computes the gradient of the raw parameters from the gradient of these
// values. They combine the functions of covariance.h, conditional.h (or direct.h), projection.h and colour.h. UBS_N
// (kernels/layout.h) sets the number of dimensions N, and the macros of kernels/variant.h select the variant of the
// method.
#pragma once

typedef struct {
  vreal e[kRowCount];  // rows as in kernels/layout.h
} SplatRaw;

typedef struct {
  vreal x, y, depth;     // mean on the image [px]; depth in world units
  ConicFactor conic;
  vreal opacity, beta;   // conditioned opacity; exponent of the spatial kernel
  vreal r, g, b;
  vreal reach;           // squared distance at which the footprint ends (reach.h)
  vreal hx, hy;          // half extents of the footprint [px], with the rounding margin
  vmask valid;           // true if the splat is visible, provided that its footprint meets the image
} SplatImage;

typedef struct {
  Vec3 value;       // not negative
  // True if the sum of 1/2 and the harmonics is > 0. A negative sum is replaced by 0 before the lobes are added.
  vmask lit[3];
  ShBasis basis;
} SplatColour;

// ViewRay is the view ray from the camera to a splat.
typedef struct {
  Vec3 to_splat;   // mean mu_x of the splat minus the camera centre
  vreal rho;       // length of to_splat, at least UBS_RHO_MIN
  Vec3 direction;
} ViewRay;

// SplatState holds the intermediate values that the forward pass and the backward pass need.
typedef struct {
  FrameRaw frame_raw;
  SpatialFrame frame;
  ViewRay sight;
#if UBS_C > 0
  SliceInput slice_in;
  Slice slice;
#endif
  Conditional conditional;
  // The conditional covariance is V = m shrink m^T. m and shrink are M and K, or M W^T and K' for a strongly coupled
  // splat (conditional.h).
  FrameMap m;
  FrameMat shrink;
#ifdef UBS_COUPLED_FACTOR
  vmask coupled;   // ThinSplats.coupled is true, and the sum of |K'| is below UBS_COUPLED_SHRINK
  QueryVec below;  // 1 - weight, without cancellation
#endif
  vreal opacity;   // base opacity o
  SplatColour colour;  // only with UBS_COLOUR > 0
  Projected projected;
} SplatState;

UBS_FN FrameRaw splat_frame_raw(SplatRaw raw) {
  FrameRaw f;
  UBS_UNROLL for (int m = 0; m < kFrameRots; ++m) f.rotation[m] = raw.e[frame_row(m)];
  UBS_UNROLL for (int c = 0; c < UBS_F; ++c) f.scale[c] = raw.e[kRowScale + c];
  return f;
}

UBS_FN Lobe splat_lobe(SplatRaw raw, int l, Vec3 direction) {
  return lobe_seen(raw.e[lobe_row(3, l)], raw.e[lobe_row(4, l)], raw.e[lobe_row(5, l)], direction);
}

UBS_FN SplatColour splat_colour(SplatRaw raw, Vec3 direction) {
  SplatColour colour;
  colour.basis = sh_basis(direction);
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    vreal sum = V(0.5);
    UBS_UNROLL for (int k = 0; k < UBS_SH_COUNT; ++k) sum += colour.basis.e[k] * raw.e[sh_row(c, k)];
    colour.lit[c] = sum > V(0.0);
    colour.value.e[c] = colour.lit[c] ? sum : sum < V(0.0) ? V(0.0) : sum;  // NaN stays NaN
  }
  UBS_UNROLL for (int l = 0; l < UBS_LOBES; ++l) {
    Lobe lobe = splat_lobe(raw, l, direction);
    UBS_UNROLL for (int c = 0; c < 3; ++c)
      colour.value.e[c] += lobe_colour(raw.e[lobe_row(c, l)]) * lobe.value;
  }
  return colour;
}

// Returns the scales of all N dimensions before they are raised to their lower bounds. They are computed together,
// which is faster than one chain of dependent instructions after the other.
UBS_FN Several splat_scales(SplatRaw raw) {
  Several scales;
  UBS_UNROLL for (int i = 0; i < UBS_N; ++i) scales.e[i] = raw.e[kRowScale + i];
  return scales_from(scales, UBS_N);
}

UBS_FN FrameVec splat_frame_scales(SplatRaw raw) {
  Several scales = splat_scales(raw);
  FrameVec out;
  UBS_UNROLL for (int c = 0; c < UBS_F; ++c) out.e[c] = scales.e[c];
  return out;
}

#define UBS_QUERY_SCALE_LEAST (UBS_COV_MODE == UBS_COV_WHITEN ? UBS_QUERY_SCALE_WHITEN : UBS_QUERY_SCALE_RELATIVE)

#if UBS_COV_PARAM == UBS_COV_SKEW_ND
// Returns entry (row, j) of I + A. In the upper triangle, the entries of A are the parameters; in the lower triangle,
// they have the opposite sign.
UBS_FN vreal splat_query_entry(SplatRaw raw, int row, int j) {
  return j < row ? -raw.e[kRowL + UBS_TRIANGLE(row, j < row ? j : 0)]
                 : j == row ? V(1.0) : raw.e[kRowL + UBS_TRIANGLE(j > row ? j : 1, j > row ? row : 0)];
}

// Returns the scales of skew_nd after raising them to their lower bounds. The scale of a query column is at least
// UBS_QUERY_SCALE_LEAST times the length of the rest of its row of (I + A) diag(s). A spatial scale is at least
// UBS_SKEW_MOTION_RELATIVE times the length of the query columns of its row. In both rules, s are the scales before
// they are raised.
#define UBS_SKEW_LEAST(row) ((row) < 3 ? UBS_SKEW_MOTION_RELATIVE : UBS_QUERY_SCALE_LEAST)
UBS_FN FrameVec skew_scales(SplatRaw raw, FrameVec scale) {
  FrameVec out = scale;
  UBS_UNROLL for (int i = 0; i < UBS_N; ++i) {
    vreal square = V(0.0);
    UBS_UNROLL for (int j = i < 3 ? 3 : 0; j < UBS_N; ++j) {
      vreal entry = splat_query_entry(raw, i, j) * scale.e[j];
      if (j != i) square += entry * entry;
    }
    out.e[i] = ubs_max(scale.e[i], (vreal)(UBS_SKEW_LEAST(i)) * ubs_sqrt(square));
  }
  return out;
}

// Replaces the gradient of the result of skew_scales() in `out` by the gradient of its inputs. A raised scale is
// k |row|, where k is the factor of the bound and |row| the length of the rest of the row. Therefore its gradient v is
// passed to the entries of the row: v k^2 entry / (k |row|) is added to the gradient of each entry.
UBS_FN SplatRaw skew_scales_vjp(SplatRaw out, SplatRaw raw, FrameVec scale, FrameVec used) {
  FrameVec v_used;
  UBS_UNROLL for (int i = 0; i < UBS_N; ++i) {
    v_used.e[i] = out.e[kRowScale + i];
    out.e[kRowScale + i] = used.e[i] > scale.e[i] ? V(0.0) : v_used.e[i];
  }
  UBS_UNROLL for (int i = 0; i < UBS_N; ++i) {
    vreal square = (vreal)(UBS_SKEW_LEAST(i) * UBS_SKEW_LEAST(i)) * v_used.e[i];
    vreal part = used.e[i] > scale.e[i] ? square / used.e[i] : V(0.0);
    UBS_UNROLL for (int j = i < 3 ? 3 : 0; j < UBS_N; ++j)
      if (j != i) {
        vreal entry = splat_query_entry(raw, i, j), v_entry = part * entry * scale.e[j];
        if (j < i) out.e[kRowL + UBS_TRIANGLE(i, j < i ? j : 0)] -= v_entry * scale.e[j];
        if (j > i) out.e[kRowL + UBS_TRIANGLE(j > i ? j : 1, j > i ? i : 0)] += v_entry * scale.e[j];
        out.e[kRowScale + j] += v_entry * entry;
      }
  }
  return out;
}
#endif

#if UBS_C > 0
// Returns the squared length of query row i of [Lqx, Lq] without the scale on the diagonal.
UBS_FN vreal query_row_square(SplatRaw raw, int i) {
  vreal square = V(0.0);
  // The loop has a constant length, so that it is unrolled. For a loop that is not unrolled, the compiler would keep a
  // copy of `raw` in memory.
  UBS_UNROLL for (int j = 0; j < 2 + UBS_C; ++j)
    if (j < i + 3) square += raw.e[kRowL + UBS_TRIANGLE(i + 3, j)] * raw.e[kRowL + UBS_TRIANGLE(i + 3, j)];
  return square;
}

// Returns the rounding error of the unit vector d = w / rho with rho = |w|, as a vector that must be added to d. It
// consists of the remainders of the divisions and of a correction for the rounding error of rho. This error matters
// because the difference of query and mean is divided by the query scale, which for a thin splat is only a hundredth of
// its row.
UBS_FN Vec3 direction_rest(Vec3 w, vreal rho, Vec3 d) {
  Vec3 rest;
  vreal beyond = ubs_fma(d.e[0], d.e[0], V(-1.0));  // |w / rho|^2 - 1
  beyond = ubs_fma(d.e[2], d.e[2], ubs_fma(d.e[1], d.e[1], beyond));
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    rest.e[c] = ubs_fma(-d.e[c], rho, w.e[c]) / rho;
    beyond += V(2.0) * d.e[c] * rest.e[c];
  }
  UBS_UNROLL for (int c = 0; c < 3; ++c) rest.e[c] -= V(0.5) * beyond * d.e[c];
  return rest;
}

// 1 if, with direct conditioning, the raw query betas are used only for the weights. In this case the weights are the
// sigmoids of the raw betas.
enum { kLearntWeights = UBS_DIRECT ? UBS_BETA_OPACITY != UBS_BETA_OPACITY_TANH : 0 };

// Computes the inputs of the slice. `rest` is the rounding error of the direction; it is only read if `thin` is 1.
UBS_FN SliceInput splat_slice_input(CameraView cam, SplatRaw raw, SpatialFrame frame, Vec3 direction, Vec3 rest,
                                    int thin) {
  SliceInput in;
  Several scales = splat_scales(raw);
  (void)rest;
  (void)thin;
  (void)scales;
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    int row = i + 3;
#if UBS_COV_PARAM == UBS_COV_SKEW_ND
    UBS_UNROLL for (int j = 0; j < UBS_N; ++j) in.b[i][j] = splat_query_entry(raw, row, j) * frame.scale.e[j];
#else
    UBS_UNROLL for (int j = 0; j < 3 + UBS_C; ++j)
      in.b[i][j] = j < row ? raw.e[kRowL + UBS_TRIANGLE(row, j < row ? j : 0)] : V(0.0);
    in.b[i][row] = scales.e[row];
    if (!UBS_DIRECT && thin)
      in.b[i][row] = ubs_max(in.b[i][row], (vreal)(UBS_QUERY_SCALE_LEAST) * ubs_sqrt(query_row_square(raw, i)));
    (void)frame;
#endif
    vreal query = (UBS_HAS_DIRECTION && i < 3) ? direction.e[i < 3 ? i : 0]
                                               : (vreal)(cam.query[i >= UBS_FIRST_VALUE ? i - UBS_FIRST_VALUE : 0]);
    in.x.e[i] = query - raw.e[kRowMean + i];
    if (UBS_HAS_DIRECTION && i < 3 && thin) in.x.e[i] += rest.e[i < 3 ? i : 0];
    vreal growth = kHasQueryBeta ? ubs_exp(raw.e[kRowQueryBeta + i]) : V(1.0);
    in.exponent.e[i] = UBS_BETA_OPACITY == UBS_BETA_OPACITY_TANH ? V(4.0) * growth : V(1.0);
    in.weight.e[i] = V(1.0);
    if (UBS_BETA_COND == UBS_BETA_COND_ON)
      in.weight.e[i] = kLearntWeights ? ubs_sigmoid(raw.e[kRowQueryBeta + i]) : growth < V(1.0) ? growth : V(1.0);
  }
  return in;
}
#endif

// ThinSplats marks thin splats. These are splats with a query scale that is a small fraction of its row, or with a
// spatial scale that is a small fraction of the largest one. They are rare in ordinary models, and are handled by
// separate code, because additional branches would make project_backward a third slower for all other splats.
typedef struct {
  vmask lifted;   // a scale is below its lower bound (UBS_QUERY_SCALE_LEAST, UBS_SCALE_LEAST)
  // The splat is strongly coupled: a query scale is below UBS_COUPLED_RELATIVE times its row, and all dimensions with
  // such a scale have weights above 1 - UBS_COUPLED_WEIGHT. Then the conditional covariance may be computed from its
  // factor (conditional.h). With direct conditioning, a row of the precision's factor is longer than UBS_DIRECT_SHARP.
  vmask coupled;
} ThinSplats;

UBS_FN ThinSplats splat_thin(SplatRaw raw) {
  ThinSplats out;
  out.lifted = out.coupled = V(1.0) < V(0.0);
  if (UBS_COV_PARAM != UBS_COV_SKEW_ND) out.lifted = any_scale_floored(splat_frame_scales(raw));
#if UBS_C > 0 && UBS_COV_PARAM != UBS_COV_SKEW_ND && !UBS_DIRECT
  Several scales = splat_scales(raw);
  vmask weak = out.coupled;
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    vreal scale = scales.e[i + 3], square = query_row_square(raw, i);
    scale *= scale;
    out.lifted = out.lifted | (scale < (vreal)(UBS_QUERY_SCALE_LEAST * UBS_QUERY_SCALE_LEAST) * square);
    vmask small = scale < (vreal)(UBS_COUPLED_RELATIVE * UBS_COUPLED_RELATIVE) * square;
    out.coupled = out.coupled | small;
    if (UBS_BETA_COND == UBS_BETA_COND_ON)
      weak = weak | (small & (raw.e[kRowQueryBeta + i] <= (vreal)(-UBS_COUPLED_WEIGHT)));
  }
  out.coupled = out.coupled & !weak;
#elif UBS_DIRECT && UBS_HAS_DIRECTION
  Several scales = splat_scales(raw);
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    vreal scale = scales.e[i + 3], square = scale * scale;
    UBS_UNROLL for (int j = 0; j < UBS_C; ++j)
      if (j < i) square += raw.e[kRowL + UBS_TRIANGLE(i + 3, 3 + j)] * raw.e[kRowL + UBS_TRIANGLE(i + 3, 3 + j)];
    out.coupled = out.coupled | (square > (vreal)(UBS_DIRECT_SHARP * UBS_DIRECT_SHARP));
  }
#else
  (void)raw;
#endif
  return out;
}

#ifdef UBS_COUPLED_FACTOR
// Returns 1 - exp(b) for b < 0.
UBS_FN vreal weight_below_one(vreal b) {
  vreal near = -b * (V(1.0) + b * (V(0.5) + b * (V(0.16666667) + b * V(0.041666667))));  // relative error 7e-9 at -0.03
  return b > V(-0.03) ? near : V(1.0) - ubs_exp(b);
}

// Sets s.m and s.shrink to M W^T and K' in the lanes with strongly coupled splats. The other lanes are not changed.
UBS_FN SplatState splat_couple(SplatRaw raw, SplatState s) {
  CoupledFactor factor = coupled_factor(s.slice_in);
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    vreal b = UBS_BETA_COND == UBS_BETA_COND_ON ? raw.e[kRowQueryBeta + i] : V(0.0);
    s.below.e[i] = b < V(0.0) ? weight_below_one(b) : V(0.0);
  }
  FrameMat shrink = coupled_weights(s.slice, factor, s.below).shrink;
  vreal largest = V(0.0);
  UBS_UNROLL for (int c = 0; c < 3; ++c)
    UBS_UNROLL for (int r = 0; r < 3; ++r) largest += ubs_fabs(shrink.e[r][c]);
  s.coupled = splat_thin(raw).coupled & (largest < (vreal)(UBS_COUPLED_SHRINK));
#if UBS_VW == 1
  if (s.coupled) {  // a branch needs fewer registers than selections (117 instead of 141 on the AMD GPU gfx90a)
    s.m = coupled_frame(s.frame.m, factor);
    s.shrink = shrink;
  }
#else
  FrameMap frame = coupled_frame(s.frame.m, factor);
  UBS_UNROLL for (int c = 0; c < 3; ++c)
    UBS_UNROLL for (int r = 0; r < 3; ++r) {
      s.m.e[r][c] = s.coupled ? frame.e[r][c] : s.m.e[r][c];
      s.shrink.e[r][c] = s.coupled ? shrink.e[r][c] : s.shrink.e[r][c];
    }
#endif
  return s;
}
#endif

// Returns the factor o_q / o of the opacity, without the blur compensation.
UBS_FN vreal splat_attenuation(Conditional conditional) {
  if (UBS_C == 0) return V(1.0);
  return UBS_BETA_OPACITY == UBS_BETA_OPACITY_NONE ? V(1.0) : exp_nonpositive(conditional.log_factor);
}

UBS_FN ViewRay splat_sight(CameraView cam, SplatRaw raw) {
  ViewRay s;
  UBS_UNROLL for (int c = 0; c < 3; ++c) s.to_splat.e[c] = raw.e[kRowXyz + c] - cam.centre[c];
  s.rho = ubs_sqrt(s.to_splat.e[0] * s.to_splat.e[0] + s.to_splat.e[1] * s.to_splat.e[1] +
                   s.to_splat.e[2] * s.to_splat.e[2]);
  s.rho = s.rho > (vreal)(UBS_RHO_MIN) ? s.rho : (vreal)(UBS_RHO_MIN);
  UBS_UNROLL for (int c = 0; c < 3; ++c) s.direction.e[c] = s.to_splat.e[c] / s.rho;
  return s;
}

// Computes the view ray early, before it is known whether there are thin splats among the lanes, so that the square
// root and the divisions are finished when they are needed. With one lane, as on GPUs, returns zeros, and splat_state()
// computes the view ray, because this needs fewer registers.
UBS_FN ViewRay view_ray_ahead(CameraView cam, SplatRaw raw) {
  ViewRay none;
  if (UBS_VW > 1) return splat_sight(cam, raw);
  UBS_UNROLL for (int c = 0; c < 3; ++c) none.to_splat.e[c] = none.direction.e[c] = V(0.0);
  none.rho = V(0.0);
  return none;
}

// Computes the intermediate values. `sight` is the result of view_ray_ahead(). `thin` is a constant: 1 if there may be
// thin splats among the lanes, otherwise 0.
UBS_FN SplatState splat_state(CameraView cam, SplatRaw raw, ViewRay sight, int thin) {
  SplatState s;
  s.frame_raw = splat_frame_raw(raw);
#if UBS_COV_PARAM == UBS_COV_SKEW_ND
  s.frame = scaled_frame(s.frame_raw, skew_scales(raw, floored_scales(splat_frame_scales(raw))));
#else
  FrameVec scales = splat_frame_scales(raw);
  s.frame = scaled_frame(s.frame_raw, thin ? floored_scales(scales) : scales);
#endif
  if (UBS_VW == 1) sight = splat_sight(cam, raw);
  s.sight = sight;
  s.opacity = UBS_GAUSSIAN_ARRAYS ? raw.e[kRowOpacity] : ubs_sigmoid(raw.e[kRowOpacity]);

  if (UBS_COLOUR > 0) s.colour = splat_colour(raw, sight.direction);

#if UBS_C > 0
  Vec3 rest;
  UBS_UNROLL for (int c = 0; c < 3; ++c) rest.e[c] = V(0.0);
  if (UBS_HAS_DIRECTION && thin) {
    Vec3 lost = direction_rest(sight.to_splat, sight.rho, sight.direction);
    vmask coupled = splat_thin(raw).coupled & (sight.rho > (vreal)(UBS_RHO_MIN));
    UBS_UNROLL for (int c = 0; c < 3; ++c) rest.e[c] = coupled ? lost.e[c] : V(0.0);
  }
  s.slice_in = splat_slice_input(cam, raw, s.frame, sight.direction, rest, thin);
  s.slice = slice_forward(s.slice_in);
  s.conditional = slice_result(s.slice_in, s.slice);
#else
  s.conditional.log_factor = V(0.0);
  UBS_UNROLL for (int r = 0; r < UBS_F; ++r) {
    s.conditional.offset.e[r] = V(0.0);
    UBS_UNROLL for (int c = 0; c < UBS_F; ++c) s.conditional.shrink.e[r][c] = r == c ? V(1.0) : V(0.0);
  }
#endif

  // The mean is computed relative to the camera, so that scenes far from the origin do not lose accuracy.
  Vec3 r;
  UBS_UNROLL for (int i = 0; i < 3; ++i) {
    r.e[i] = sight.to_splat.e[i];
    if (UBS_DIRECT) {
      r.e[i] += mean_scale(s.frame.scale) * s.conditional.offset.e[i];
    } else {
      UBS_UNROLL for (int j = 0; j < UBS_F; ++j) r.e[i] += s.frame.m.e[i][j] * s.conditional.offset.e[j];
    }
  }
  s.m = s.frame.m;
  s.shrink = s.conditional.shrink;
#ifdef UBS_COUPLED_FACTOR
  if (thin) s = splat_couple(raw, s);
#else
  (void)thin;
#endif
  s.projected = project(cam, r, s.m, s.shrink);
  return s;
}

UBS_FN SplatImage splat_image(SplatRaw raw, SplatState s) {
  SplatImage out;
  out.x = s.projected.x;
  out.y = s.projected.y;
  out.depth = s.projected.p.e[2];
  out.conic = conic_factor(s.projected.ellipse.cov, s.projected.ellipse.det);
  out.opacity = s.opacity * splat_attenuation(s.conditional);
  if (UBS_ANTIALIAS) out.opacity *= s.projected.ellipse.compensation;
  out.beta = V(0.0);
  if (kHasSpatialBeta) {
    vreal raw_beta = raw.e[kRowBeta];
    out.beta = V(4.0) * ubs_exp(raw_beta < (vreal)(UBS_BETA_RAW_MAX) ? raw_beta : (vreal)(UBS_BETA_RAW_MAX));
  }
  out.r = UBS_COLOUR > 0 ? s.colour.value.e[0] : raw.e[kRowRgb];
  out.g = UBS_COLOUR > 0 ? s.colour.value.e[1] : raw.e[kRowRgb + 1];
  out.b = UBS_COLOUR > 0 ? s.colour.value.e[2] : raw.e[kRowRgb + 2];
  out.reach = UBS_OPACITY_EXTENTS ? splat_reach(out.opacity, out.beta) : (vreal)(UBS_SUPPORT);
  out.hx = ubs_sqrt(out.reach * s.projected.ellipse.cov.a) + (vreal)(UBS_FOOTPRINT_MARGIN);
  out.hy = ubs_sqrt(out.reach * s.projected.ellipse.cov.c) + (vreal)(UBS_FOOTPRINT_MARGIN);
  // A splat whose opacity is at most UBS_ALPHA_MIN renders nothing and has no gradient. If UBS_ALPHA_MIN is 0, this
  // only happens by underflow, when the query is far from the query mean of the splat.
  out.valid = s.projected.valid & (out.opacity > (vreal)(UBS_ALPHA_MIN));
  out.valid = out.valid & (out.reach > V(0.0)) & ubs_finite(out.beta) & ubs_finite(out.conic.l00) &
              ubs_finite(out.conic.l01) & ubs_finite(out.conic.l11) & ubs_finite(out.r + out.g + out.b);
  return out;
}

// SplatImageVjp is the gradient of the loss with respect to the values of SplatImage that the rasteriser has used.
typedef struct {
  vreal x, y;
  EllipseVjp ellipse;
  vreal opacity, beta, r, g, b;
  vreal depth;  // only read with UBS_DEPTH_GRAD
} SplatImageVjp;

// The result of splat_vjp(). It is the gradient of the parameters, or, with UBS_CAMERA_GRAD, the gradient of the
// camera.
#ifdef UBS_CAMERA_GRAD
typedef CameraVjp SplatVjp;
#else
typedef SplatRaw SplatVjp;
#endif

#if UBS_C > 0
// Computes the gradients of the raw parameters in `out` from those of the inputs of the slice. The caller adds the
// gradient through the view direction.
UBS_FN SplatRaw splat_slice_vjp(SplatRaw out, SplatRaw raw, SpatialFrame frame, SliceInput in, SliceVjp q, int thin) {
  (void)frame;
  (void)in;
  (void)thin;
  UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
    int row = i + 3;
#if UBS_COV_PARAM == UBS_COV_SKEW_ND
    UBS_UNROLL for (int j = 0; j < UBS_N; ++j) {
      vreal v_entry = q.b[i][j] * frame.scale.e[j];
      if (j < row) out.e[kRowL + UBS_TRIANGLE(row, j < row ? j : 0)] -= v_entry;
      if (j > row) out.e[kRowL + UBS_TRIANGLE(j > row ? j : 1, j > row ? row : 0)] += v_entry;
      out.e[kRowScale + j] += q.b[i][j] * splat_query_entry(raw, row, j);
    }
#else
    UBS_UNROLL for (int j = 0; j < 3 + UBS_C; ++j)
      if (j < row) out.e[kRowL + UBS_TRIANGLE(row, j)] = q.b[i][j];
    out.e[kRowScale + row] = q.b[i][row] * scale_slope(raw.e[kRowScale + row]);
    if (!UBS_DIRECT && thin) {
      // A raised scale is s = k |row|, so its gradient v_s is passed to the row: v_s ds/drow = v_s k^2 row / s.
      vmask lifted = in.b[i][row] > splat_scales(raw).e[row];
      vreal v_row = q.b[i][row] * (vreal)(UBS_QUERY_SCALE_LEAST * UBS_QUERY_SCALE_LEAST) / in.b[i][row];
      UBS_UNROLL for (int j = 0; j < 3 + UBS_C; ++j)
        if (j < row)
          out.e[kRowL + UBS_TRIANGLE(row, j)] = lifted ? q.b[i][j] + v_row * in.b[i][j] : q.b[i][j];
      out.e[kRowScale + row] = lifted ? V(0.0) : out.e[kRowScale + row];
    }
#endif
    out.e[kRowMean + i] = -q.x.e[i];
    if (kHasQueryBeta) {
      // The weight is min(exp(b), 1). At b = 0 the slope is defined as 0, as in the published code, so b < 0 is strict.
      vreal bq = UBS_BETA_COND == UBS_BETA_COND_ON ? raw.e[kRowQueryBeta + i] : V(0.0);
      vreal v_beta = bq < V(0.0) ? in.weight.e[i] * q.weight.e[i] : V(0.0);
      if (kLearntWeights) v_beta = in.weight.e[i] * (V(1.0) - in.weight.e[i]) * q.weight.e[i];
      if (UBS_BETA_OPACITY == UBS_BETA_OPACITY_TANH) v_beta = in.exponent.e[i] * q.exponent.e[i] + v_beta;
      out.e[kRowQueryBeta + i] = v_beta;
    }
  }
  return out;
}
#endif

UBS_FN vreal splat_lobe_weight(SplatRaw raw, int l, Vec3 v) {
  return v.e[0] * lobe_colour(raw.e[lobe_row(0, l)]) + v.e[1] * lobe_colour(raw.e[lobe_row(1, l)]) +
         v.e[2] * lobe_colour(raw.e[lobe_row(2, l)]);
}

// Returns the gradient of the direction. v is the gradient of the colour. v_lit is the same gradient, but zero in the
// channels in which the sum of the harmonics is clamped to 0.
UBS_FN Vec3 splat_colour_direction_vjp(SplatRaw raw, Vec3 direction, Vec3 v, Vec3 v_lit) {
  ShBasis weight;
  UBS_UNROLL for (int k = 0; k < UBS_SH_COUNT; ++k)
    weight.e[k] = v_lit.e[0] * raw.e[sh_row(0, k)] + v_lit.e[1] * raw.e[sh_row(1, k)] +
                  v_lit.e[2] * raw.e[sh_row(2, k)];
  Vec3 v_d = sh_basis_vjp(direction, weight);
  UBS_UNROLL for (int l = 0; l < UBS_LOBES; ++l) {
    Lobe lobe = splat_lobe(raw, l, direction);
    vreal v_u = splat_lobe_weight(raw, l, v) * lobe.slope;
    UBS_UNROLL for (int c = 0; c < 3; ++c) v_d.e[c] += v_u * lobe.m.e[c];
  }
  return v_d;
}

UBS_FN SplatRaw splat_lobe_vjp(SplatRaw out, SplatRaw raw, int l, Vec3 d, Vec3 v) {
  Lobe lobe = splat_lobe(raw, l, d);
  vreal weight = splat_lobe_weight(raw, l, v), v_u = weight * lobe.slope;
  vreal raw_beta = raw.e[lobe_row(5, l)];
  UBS_UNROLL for (int c = 0; c < 3; ++c)
    out.e[lobe_row(c, l)] = v.e[c] * lobe_colour_slope(raw.e[lobe_row(c, l)]) * lobe.value;
  out.e[lobe_row(3, l)] =
      v_u * (d.e[0] * lobe.m_theta.e[0] + d.e[1] * lobe.m_theta.e[1] + d.e[2] * lobe.m_theta.e[2]);
  out.e[lobe_row(4, l)] = v_u * (d.e[0] * lobe.m_phi.e[0] + d.e[1] * lobe.m_phi.e[1]);
  out.e[lobe_row(5, l)] =
      raw_beta < (vreal)(UBS_BETA_RAW_MAX) ? weight * lobe.value * lobe.log_value : V(0.0);
  return out;
}

UBS_FN SplatVjp splat_vjp(CameraView cam, SplatRaw raw, ViewRay sight, SplatImageVjp v, int thin) {
  SplatState s = splat_state(cam, raw, sight, thin);
  SplatRaw out;
  if (UBS_COV_PARAM == UBS_COV_SKEW_ND)  // start at 0, because gradients from both triangles of A are added
    UBS_UNROLL for (int k = 0; k < kRowCount; ++k) out.e[k] = V(0.0);
  Vec3 v_colour;
  v_colour.e[0] = v.r;
  v_colour.e[1] = v.g;
  v_colour.e[2] = v.b;
  Vec3 v_lit = v_colour;
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    if (UBS_COLOUR == 0) out.e[kRowRgb + c] = v_colour.e[c];
    if (UBS_COLOUR > 0) v_lit.e[c] = s.colour.lit[c] ? v_colour.e[c] : V(0.0);
    UBS_UNROLL for (int k = 0; k < UBS_SH_COUNT; ++k)
      out.e[sh_row(c, k)] = s.colour.basis.e[k] * v_lit.e[c];
  }
  UBS_UNROLL for (int l = 0; l < UBS_LOBES; ++l) out = splat_lobe_vjp(out, raw, l, s.sight.direction, v_colour);
  if (kHasSpatialBeta) {  // the derivative of 4 exp(b) is 4 exp(b), or 0 if b is above UBS_BETA_RAW_MAX
    vreal raw_beta = raw.e[kRowBeta];
    out.e[kRowBeta] = raw_beta < (vreal)(UBS_BETA_RAW_MAX) ? v.beta * V(4.0) * ubs_exp(raw_beta) : V(0.0);
  }
  vreal factor = splat_attenuation(s.conditional), v_compensation = V(0.0);
  if (UBS_ANTIALIAS) {
    v_compensation = v.opacity * s.opacity * factor;
    factor *= s.projected.ellipse.compensation;
  }
  out.e[kRowOpacity] = v.opacity * factor;
  if (!UBS_GAUSSIAN_ARRAYS) out.e[kRowOpacity] = out.e[kRowOpacity] * s.opacity * ubs_sigmoid(-raw.e[kRowOpacity]);

  // M occurs not only in the covariance, but also in the mean mu_c = mu_x + M k: v_k = M^T v_mu, v_M += v_mu k^T.
  ProjectVjp p = project_vjp(cam, s.m, s.shrink, s.projected, v.x, v.y, v.ellipse, v_compensation, v.depth);
#ifdef UBS_COUPLED_FACTOR
  CoupledVjp factor_vjp;
  if (thin) {
    factor_vjp =
        coupled_vjp(s.slice, s.frame.m, s.m, coupled_factor(s.slice_in), s.below, p.m, p.shrink);
    UBS_UNROLL for (int c = 0; c < 3; ++c) {
      p.along.e[c] = s.coupled ? factor_vjp.along.e[c] : p.along.e[c];
      UBS_UNROLL for (int r = 0; r < 3; ++r) {
        p.m.e[r][c] = s.coupled ? factor_vjp.m.e[r][c] : p.m.e[r][c];
        p.k.e[r][c] = s.coupled ? V(0.0) : p.k.e[r][c];
      }
    }
  }
#endif
  FrameMap v_m = p.m;
  FrameVec stretch = p.along;
#if UBS_C > 0 && UBS_DIRECT
  // mu_c = mu_x + s k, where s is the mean scale.
  FrameVec v_k;
  vreal scale = mean_scale(s.frame.scale), v_scale_third = V(0.0);
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    v_k.e[c] = scale * p.r.e[c];
    v_scale_third += (vreal)(R(1.0) / R(3.0)) * p.r.e[c] * s.conditional.offset.e[c];
  }
#elif UBS_C > 0
  FrameVec v_k;
  UBS_UNROLL for (int c = 0; c < UBS_F; ++c) {
    UBS_UNROLL for (int r = 0; r < 3; ++r) v_m.e[r][c] += p.r.e[r] * s.conditional.offset.e[c];
    v_k.e[c] = s.frame.m.e[0][c] * p.r.e[0] + s.frame.m.e[1][c] * p.r.e[1] + s.frame.m.e[2][c] * p.r.e[2];
    stretch.e[c] += v_k.e[c] * s.conditional.offset.e[c];
  }
#endif

  FrameRaw f = scaled_frame_vjp(s.frame, s.frame_raw, v_m, stretch);
  UBS_UNROLL for (int m = 0; m < kFrameRots; ++m) out.e[frame_row(m)] = f.rotation[m];
  FrameVec v_scale;
  UBS_UNROLL for (int c = 0; c < UBS_F; ++c) v_scale.e[c] = f.scale[c];
#if UBS_C > 0 && UBS_DIRECT
  UBS_UNROLL for (int c = 0; c < 3; ++c) v_scale.e[c] += v_scale_third;
#endif
  if (UBS_COV_PARAM != UBS_COV_SKEW_ND) v_scale = frame_scales_vjp(s.frame_raw, v_scale, thin);
  UBS_UNROLL for (int c = 0; c < UBS_F; ++c) out.e[kRowScale + c] = v_scale.e[c];
  UBS_UNROLL for (int c = 0; c < 3; ++c) out.e[kRowXyz + c] = p.r.e[c];

#if UBS_C > 0
  SliceVjp q = slice_vjp(s.slice_in, s.slice, v_k, p.k, v.opacity * s.opacity * factor);
#ifdef UBS_COUPLED_FACTOR
  if (thin)
    UBS_UNROLL for (int i = 0; i < UBS_C; ++i) {
      q.weight.e[i] += s.coupled ? factor_vjp.weight.e[i] : V(0.0);
      UBS_UNROLL for (int j = 0; j < 3 + UBS_C; ++j) q.b[i][j] += s.coupled ? factor_vjp.b[i][j] : V(0.0);
    }
#endif
  out = splat_slice_vjp(out, raw, s.frame, s.slice_in, q, thin);
#endif

#if UBS_COV_PARAM == UBS_COV_SKEW_ND
  out = skew_scales_vjp(out, raw, floored_scales(splat_frame_scales(raw)), s.frame.scale);
  UBS_UNROLL for (int c = 0; c < UBS_F; ++c) v_scale.e[c] = out.e[kRowScale + c];
  v_scale = frame_scales_vjp(s.frame_raw, v_scale, 1);
  UBS_UNROLL for (int c = 0; c < UBS_F; ++c) out.e[kRowScale + c] = v_scale.e[c];
#endif

#if (defined(UBS_QUERY_GRAD) || defined(UBS_CAMERA_GRAD)) && (UBS_HAS_DIRECTION || UBS_COLOUR > 1)
  // The direction is d = w / |w|, so v_w = (I - d d^T) v_d / |w|.
#if UBS_HAS_DIRECTION
  Vec3 v_d;
  UBS_UNROLL for (int c = 0; c < 3; ++c) v_d.e[c] = q.x.e[c];
#if UBS_COLOUR > 1
  Vec3 v_seen = splat_colour_direction_vjp(raw, s.sight.direction, v_colour, v_lit);
  UBS_UNROLL for (int c = 0; c < 3; ++c) v_d.e[c] += v_seen.e[c];
#endif
#else
  Vec3 v_d = splat_colour_direction_vjp(raw, s.sight.direction, v_colour, v_lit);
#endif
  Vec3 d = s.sight.direction;
  vreal along = v_d.e[0] * d.e[0] + v_d.e[1] * d.e[1] + v_d.e[2] * d.e[2];
#ifdef UBS_CAMERA_GRAD
  UBS_UNROLL for (int c = 0; c < 3; ++c) {
    vreal v_w = (v_d.e[c] - along * d.e[c]) / s.sight.rho;
    UBS_UNROLL for (int i = 0; i < 3; ++i) p.camera.e[kCameraGradShift + i] += cam.rotation[i][c] * v_w;
  }
#else
  UBS_UNROLL for (int c = 0; c < 3; ++c) out.e[kRowXyz + c] += (v_d.e[c] - along * d.e[c]) / s.sight.rho;
#endif
#endif
#ifdef UBS_CAMERA_GRAD
#if UBS_C > UBS_FIRST_VALUE
  UBS_UNROLL for (int i = UBS_FIRST_VALUE; i < UBS_C; ++i) p.camera.e[kCameraGradQuery + i - UBS_FIRST_VALUE] = q.x.e[i];
#endif
  (void)out;
  return p.camera;
#else
  return out;
#endif
}
