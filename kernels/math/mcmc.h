// SPDX-License-Identifier: Apache-2.0
// mcmc.h contains the formulas for relocation, growth and noise of one splat (method.md 4.3). It requires covariance.h.
#pragma once

#if defined(UBS_OPENCL)
#define ubs_expm1(x) expm1(x)
#elif defined(UBS_HOST)
#define ubs_expm1(x) ::expm1(x)
#else
#define ubs_expm1(x) expm1f(x)
#endif

// Range of opacities after relocation, in raw parameters: logit(0.005) and logit(1 - 2^-23).
#define UBS_RAW_OPACITY_MIN R(-5.2933048247244923)
#define UBS_RAW_OPACITY_MAX R(15.942385033669446)

UBS_FN Vec3 finite_or_zero(Vec3 v) {
  vmask finite = ubs_finite(v.e[0]) & ubs_finite(v.e[1]) & ubs_finite(v.e[2]);
  for (int r = 0; r < 3; ++r) v.e[r] = finite ? v.e[r] : V(0.0);
  return v;
}

// Returns the weight of a splat for sampling. Weights are integers, o * 2^24 rounded to the nearest, so that their sum
// is exact and independent of the order. NaN gives weight 0.
UBS_FN vreal sampling_weight(vreal raw_opacity) {
  vreal opacity = ubs_sigmoid(raw_opacity);
  return opacity > V(0.0) ? ubs_floor(opacity * R(16777216.0) + V(0.5)) : V(0.0);
}

// Returns the weight of a splat for sampling if it is alive, and 0 if it is dead. A splat whose opacity is NaN counts
// as dead. The weight 0 always means a dead splat, because the weight of a live splat is at least 83886.
UBS_FN vreal sampling_weight_alive(vreal raw_opacity) {
  return ubs_sigmoid(raw_opacity) > (vreal)(UBS_OPACITY_DEAD) ? sampling_weight(raw_opacity) : V(0.0);
}

// Returns softplus^-1(q) = ln(e^q - 1) for q > 0. It is computed as q + ln(1 - e^-q), because this is accurate for
// small and for large q.
UBS_FN vreal softplus_inverse(vreal q) { return q + ubs_log(-ubs_expm1(-q)); }

// Returns the new raw opacity of a source and of its copies. `parts` is the number of copies plus 1. Together, these
// splats absorb as much as the source did before: (1 - o')^parts = 1 - o. Since -ln(1 - o) = softplus(raw), this means
// softplus(raw') = q with q = softplus(raw) / parts. For NaN the result is the lower bound.
UBS_FN vreal split_raw_opacity(vreal raw_opacity, vreal parts) {
  vreal q = ubs_softplus(raw_opacity) / parts;
  vreal raw = softplus_inverse(q);
  raw = raw < (vreal)(UBS_RAW_OPACITY_MAX) ? raw : (vreal)(UBS_RAW_OPACITY_MAX);
  return ((raw > (vreal)(UBS_RAW_OPACITY_MIN)) & (q >= V(0.0))) ? raw : (vreal)(UBS_RAW_OPACITY_MIN);
}

// Returns the factor f by which a copy and its source become smaller if the copy is displaced by spread f M n, where n
// is a vector of normal numbers and M the factor of the source before. Over the draws of n, the covariance of the copy
// about the place of its source is f^2 M M^T + spread^2 f^2 M M^T, and f makes it equal to M M^T.
UBS_FN vreal copy_shrink(vreal spread) { return V(1.0) / ubs_sqrt(V(1.0) + spread * spread); }

// Returns the raw spatial scale of a copy and of its source. If the result is not finite, the scale is not changed.
UBS_FN vreal copy_raw_scale(vreal raw, vreal shrink) {
  vreal out = softplus_inverse(shrink * ubs_softplus(raw));
  return ubs_finite(out) ? out : raw;
}

// Returns the displacement of a copy, spread M normals, or zero if it is not finite. `frame` is that of the copy. With
// skew_nd, only the spatial columns of M are used, because the others contain the motion of the splat.
UBS_FN Vec3 copy_displacement(SpatialFrame frame, Vec3 normals, vreal spread) {
  Vec3 out;
  for (int r = 0; r < 3; ++r)
    out.e[r] = spread * (frame.m.e[r][0] * normals.e[0] + frame.m.e[r][1] * normals.e[1] +
                         frame.m.e[r][2] * normals.e[2]);
  return finite_or_zero(out);
}

// Returns (1 - o)^100 by repeated squaring. 1 - o is computed as sigmoid(-raw), which is accurate near o = 1.
UBS_FN vreal noise_gate(vreal raw_opacity) {
  vreal p1 = ubs_sigmoid(-raw_opacity);
  vreal p2 = p1 * p1;
  vreal p4 = p2 * p2;
  vreal p8 = p4 * p4;
  vreal p16 = p8 * p8;
  vreal p32 = p16 * p16;
  return p32 * p32 * p32 * p4;
}

// Returns the product of Sigma_x = M M^T and normals * noise_gate() * amount, or zero if it is not finite.
UBS_FN Vec3 noise_displacement(SpatialFrame frame, vreal raw_opacity, Vec3 normals, real amount) {
  FrameVec turned;
  Vec3 out;
  vreal scale = noise_gate(raw_opacity) * amount;
  for (int c = 0; c < UBS_F; ++c)
    turned.e[c] =
        (frame.m.e[0][c] * normals.e[0] + frame.m.e[1][c] * normals.e[1] + frame.m.e[2][c] * normals.e[2]) *
        scale;
  for (int r = 0; r < 3; ++r) {
    out.e[r] = frame.m.e[r][0] * turned.e[0];
    for (int c = 1; c < UBS_F; ++c) out.e[r] += frame.m.e[r][c] * turned.e[c];
  }
  return finite_or_zero(out);
}
