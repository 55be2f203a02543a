// SPDX-License-Identifier: Apache-2.0
// The formulas of the spatial kernels (method.md 2.6, 3.1), with one block per kernel. variant.h contains their numbers.
// A kernel is a function F(r, beta) of the squared distance r from the mean, in units of the ellipse. Kernels without
// UBS_KERNEL_HAS_BETA do not use beta. A block defines these functions:
//   falloff_near(r)                   r itself, or the nearest value for which the next functions are finite
//   falloff_begin(r, beta)            the part of the exponent that does not have to wait for the opacity
//   falloff_exponent(begun, r, beta)  log2 F, from the result of falloff_begin()
//   falloff_slopes(...)               the derivatives, see FalloffSlopes
//   falloff_factor(beta)              the factor of the derivative that is the same for all pixels
//   falloff_reach(ratio, beta, margin)
//                                     the r at which ln F = -ratio, plus `margin`; 0 or negative if ratio < 0. If it is
//                                     not known, UBS_SUPPORT.
#pragma once

// The rasteriser needs 1 / (1 - alpha) together with the derivatives, because the Beta kernel computes both from one
// reciprocal.
typedef struct {
  vreal behind;  // remaining / (1 - alpha)
  vreal r;       // -d(ln F)/dr, without the factor falloff_factor()
  vreal beta;    // d(log2 F)/dbeta; 0 for kernels without beta
} FalloffSlopes;

#if UBS_FALLOFF == UBS_FALLOFF_BETA
// F = (1 - r)^beta. falloff_begin() returns log2(1 - r).
UBS_FN vreal falloff_near(vreal r) {
  // The result of this minimum is available sooner than that of a selection by the support.
  return r < (vreal)(UBS_BELOW_ONE) ? r : (vreal)(UBS_BELOW_ONE);
}
UBS_FN vreal falloff_begin(vreal r, real beta) {
  (void)beta;
  return ubs_log2_1m(r);
}
UBS_FN vreal falloff_exponent(vreal begun, vreal r, real beta) {
  (void)r;
  return beta * begun;
}
// d(ln F)/dr = -beta / (1 - r), where 1 - r is at least UBS_RIM. d(log2 F)/dbeta = log2(1 - r).
UBS_FN FalloffSlopes falloff_slopes(vreal begun, vreal r, real beta, vreal remaining, vreal one_minus_alpha) {
  (void)beta;
  vreal rim = V(1.0) - r;
  rim = rim < (vreal)(UBS_RIM) ? (vreal)(UBS_RIM) : rim;
  vreal inverse = ubs_reciprocal(one_minus_alpha * rim);
  FalloffSlopes s;
  s.behind = remaining * (inverse * rim);
  s.r = inverse * one_minus_alpha;
  s.beta = begun;
  return s;
}
UBS_FN real falloff_factor(real beta) { return beta; }
UBS_FN vreal falloff_reach(vreal ratio, vreal beta, real margin) {
  vreal reach = V(1.0) - ubs_exp2(-UBS_LOG2E * ratio / beta) + margin;
  return ratio > V(0.0) ? reach : V(0.0);
}

#elif UBS_FALLOFF == UBS_FALLOFF_GAUSSIAN
// F = exp(-r / 2)
UBS_FN vreal falloff_near(vreal r) { return r; }
UBS_FN vreal falloff_begin(vreal r, real beta) {
  (void)r, (void)beta;
  return V(0.0);
}
UBS_FN vreal falloff_exponent(vreal begun, vreal r, real beta) {
  (void)begun, (void)beta;
  return R(-0.5) * UBS_LOG2E * r;
}
// d(ln F)/dr = -1/2
UBS_FN FalloffSlopes falloff_slopes(vreal begun, vreal r, real beta, vreal remaining, vreal one_minus_alpha) {
  (void)begun, (void)r, (void)beta;
  FalloffSlopes s;
  s.behind = remaining / one_minus_alpha;
  s.r = V(1.0);
  s.beta = V(0.0);
  return s;
}
UBS_FN real falloff_factor(real beta) {
  (void)beta;
  return R(0.5);
}
UBS_FN vreal falloff_reach(vreal ratio, vreal beta, real margin) {
  (void)beta;
  return R(2.0) * ratio + margin;
}

#elif UBS_FALLOFF == UBS_FALLOFF_OWN
// F = 2^G. The user writes G and its derivatives as expressions of r and beta (OwnFalloff of host/device/stages.hpp).
// own_inside() moves r away from the centre and from the end of the support, so that the expressions and their rounded
// terms are finite. `rim` is the minimum distance from the end, as a fraction of UBS_SUPPORT. For slopes it is UBS_RIM,
// the same value that limits the slope of the Beta kernel.
UBS_FN vreal own_inside(vreal r, real rim) {
  r = r < (vreal)(UBS_SUPPORT * (R(1.0) - rim)) ? r : (vreal)(UBS_SUPPORT * (R(1.0) - rim));
  return r > (vreal)(UBS_SUPPORT * R(1e-12)) ? r : (vreal)(UBS_SUPPORT * R(1e-12));
}
UBS_FN vreal own_log2(vreal r, vreal beta) { return UBS_OWN_LOG2; }
UBS_FN vreal own_r_slope(vreal r, vreal beta) { return UBS_OWN_R_SLOPE; }
UBS_FN vreal own_beta_slope(vreal r, vreal beta) { return UBS_OWN_BETA_SLOPE; }

UBS_FN vreal falloff_near(vreal r) { return own_inside(r, R(1e-6)); }
UBS_FN vreal falloff_begin(vreal r, real beta) { return own_log2(r, (vreal)(beta)); }
UBS_FN vreal falloff_exponent(vreal begun, vreal r, real beta) {
  (void)r, (void)beta;
  return begun;
}
UBS_FN FalloffSlopes falloff_slopes(vreal begun, vreal r, real beta, vreal remaining, vreal one_minus_alpha) {
  (void)begun;
  FalloffSlopes s;
  s.behind = remaining / one_minus_alpha;
  s.r = -UBS_LN2 * own_r_slope(own_inside(r, UBS_RIM), (vreal)(beta));
  s.beta = own_beta_slope(r, (vreal)(beta));
  return s;
}
UBS_FN real falloff_factor(real beta) {
  (void)beta;
  return R(1.0);
}
// The inverse of the user's expressions is not known.
UBS_FN vreal falloff_reach(vreal ratio, vreal beta, real margin) {
  (void)ratio, (void)beta, (void)margin;
  return (vreal)(UBS_SUPPORT);
}
#endif
