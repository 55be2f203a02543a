// SPDX-License-Identifier: Apache-2.0
// One splat at one pixel: spatial kernel, alpha, front-to-back compositing, and its gradient
// (method.md 2.6, 3.1). Used by every rasteriser; lanes are pixels. d = splat mean - pixel centre.
// The kernel is (1 - r)^beta on r < 1, or with UBS_FALLOFF_GAUSSIAN exp(-r/2) where alpha >= 1/255; with
// UBS_ALPHA_MIN only where alpha exceeds it. UBS_NO_V_SHAPE, _OPACITY, _BETA, _COLOUR: nobody asks for the gradient
// of mean and conic, of the opacity, ...; its sums stay zero.
#pragma once

// The splat's values that blending reads; uniform over the pixels of a block.
typedef struct {
  real l00, l01, l11;  // factor of the conic
  real opacity, beta;
  real r, g, b;
} BlendSplat;

typedef struct {
  vreal p, q;      // L d: the distance in the ellipse's own coordinates
  vreal r;         // p^2 + q^2, in units of the support radius, at most just below 1 (Gaussian: of its deviation)
  vreal log2_1mr;  // log2(1 - r); undefined for a Gaussian
  vreal falloff;   // (1 - r)^beta
  vreal alpha;     // 0 outside the support
  vmask inside;    // r < 1 (Gaussian: alpha >= 1/255) and alpha > UBS_ALPHA_MIN, where there is one
  vmask passes;    // inside, and alpha is below its maximum: a gradient passes
} BlendAlpha;

// blend_alpha in two halves of about the same time, for rasterisers that begin a splat before they end another.
// The first fills p, q, r, log2_1mr and inside.
UBS_FN BlendAlpha blend_begin(BlendSplat s, vreal dx, vreal dy) {
  BlendAlpha a;
  a.p = ubs_fma((vreal)(s.l00), dx, s.l01 * dy);
  a.q = s.l11 * dy;
  a.r = ubs_fma(a.p, a.p, a.q * a.q);
  a.inside = a.r < (vreal)(UBS_SUPPORT);
  a.log2_1mr = V(0.0);
  if (UBS_FALLOFF == UBS_FALLOFF_BETA) {
    a.r = a.r < (vreal)(UBS_BELOW_ONE) ? a.r : (vreal)(UBS_BELOW_ONE);  // sooner there than a choice by `inside`
    a.log2_1mr = ubs_log2_1m(a.r);
  }
  a.falloff = a.alpha = V(0.0);
  a.passes = a.inside;
  return a;
}
UBS_FN BlendAlpha blend_end(BlendSplat s, BlendAlpha a) {
  // 1 outside: what is nearly 0 there makes denormal products, which cost CPUs a quarter of a rasteriser's time.
  a.falloff = UBS_FALLOFF == UBS_FALLOFF_GAUSSIAN ? ubs_exp2(R(-0.5) * UBS_LOG2E * (a.inside ? a.r : V(0.0)))
                                                  : ubs_exp2(a.inside ? s.beta * a.log2_1mr : V(0.0));
  vreal raw = s.opacity * a.falloff;
  if (UBS_FALLOFF == UBS_FALLOFF_GAUSSIAN) a.inside = a.inside & (raw >= (vreal)(UBS_ALPHA_MIN_GAUSSIAN));
  vreal most = (vreal)(UBS_FALLOFF == UBS_FALLOFF_GAUSSIAN ? UBS_ALPHA_MAX_GAUSSIAN : UBS_ALPHA_MAX);
  vmask capped = raw > most;
  raw = capped ? most : raw;
  if (UBS_ALPHA_MIN > R(0.0)) a.inside = a.inside & (raw > (vreal)(UBS_ALPHA_MIN));
  a.passes = a.inside & !capped;
  a.alpha = a.inside ? raw : V(0.0);
  return a;
}

UBS_FN BlendAlpha blend_alpha(BlendSplat s, vreal dx, vreal dy) { return blend_end(s, blend_begin(s, dx, dy)); }

// Transmittance behind the splat and the splat's weight alpha * T. A pixel that the splat would
// finish takes nothing of it and is closed: its `open` transmittance becomes 0 from then on.
typedef struct {
  vreal weight;
  vreal open;        // transmittance if the pixel goes on, else 0
  vmask composited;  // the splat is part of the pixel
} BlendStep;

UBS_FN BlendStep blend_step(BlendAlpha a, vreal open) {
  BlendStep s;
  vreal next = ubs_fma(-open, a.alpha, open);
  s.composited = next > (vreal)(UBS_TRANSMITTANCE_MIN);
  s.weight = s.composited ? open * a.alpha : V(0.0);
  s.open = s.composited ? next : V(0.0);
  return s;
}

// Mean depth of what was composited, from sum(weight z) and sum(weight); 0 where nothing was.
UBS_FN vreal blend_expected_depth(vreal weighted_depth, vreal weight) {
  return weighted_depth / ubs_max(weight, V(1e-10));
}

// Gradient of one splat at one pixel, as sums that need no uniform factors (those are applied once
// per splat or tile in blend_factors): with h = v_alpha * alpha / max(1-r, rim) and (p, q) = L d,
//   v_mean = -2 beta L^T sum h (p, q),   W = beta sum h (p, q) (p, q)^T   (EllipseVjp of ellipse.h).
// |(p, q)| < 1 inside the support. In pixels, sums of h d d^T, a thin ellipse would lose its small axis in the large.
// A Gaussian has h = v_alpha * alpha and 1/2 in the place of beta.
typedef struct {
  vreal hp, hq, hpp, hpq, hqq;  // h p, h q, h p^2, h p q, h q^2
  vreal opacity;                // falloff * v_alpha
  vreal log_beta;               // alpha log2(1-r) v_alpha
  vreal r, g, b;                // weight * v_pixel
} BlendSums;

UBS_FN BlendSums blend_no_sums(void) {
  BlendSums s;
  s.hp = s.hq = s.hpp = s.hpq = s.hqq = s.opacity = s.log_beta = s.r = s.g = s.b = V(0.0);
  return s;
}

// v_pixel . (colour composited behind the splat, background included), given the same before it.
UBS_FN vreal blend_remaining(BlendSplat s, BlendStep step, vreal remaining, vreal v_r, vreal v_g, vreal v_b) {
  return remaining - step.weight * (s.r * v_r + s.g * v_g + s.b * v_b);
}

// Adds the splat's part at one pixel to `sums`; one expression a sum, so that each is one fused instruction.
// open: transmittance before the splat; remaining: blend_remaining of this splat;
// v_*: gradient of the loss to the pixel's colour.
UBS_FN BlendSums blend_vjp(BlendSums sums, BlendSplat s, BlendAlpha a, BlendStep step, vreal open, vreal remaining,
                           vreal v_r, vreal v_g, vreal v_b) {
#ifndef UBS_NO_V_COLOUR
  sums.r += step.weight * v_r;
  sums.g += step.weight * v_g;
  sums.b += step.weight * v_b;
#endif
  vreal one_minus_alpha = V(1.0) - a.alpha;
  vreal rim = V(1.0) - a.r;
  rim = rim < (vreal)(UBS_RIM) ? (vreal)(UBS_RIM) : rim;
  vreal inverse = ubs_reciprocal(one_minus_alpha * rim);  // Beta: one division for both quotients
  vreal v_alpha = open * (s.r * v_r + s.g * v_g + s.b * v_b) -
                  (UBS_FALLOFF == UBS_FALLOFF_BETA ? remaining * (inverse * rim) : remaining / one_minus_alpha);
  v_alpha = (step.composited & a.passes) ? v_alpha : V(0.0);
#ifndef UBS_NO_V_OPACITY
  sums.opacity += a.falloff * v_alpha;
#endif
  vreal h = a.alpha * v_alpha;
#ifndef UBS_NO_V_BETA
  if (UBS_FALLOFF == UBS_FALLOFF_BETA) sums.log_beta += h * a.log2_1mr;
#endif
  if (UBS_FALLOFF == UBS_FALLOFF_BETA) h = h * (inverse * one_minus_alpha);
#ifndef UBS_NO_V_SHAPE
  vreal hp = h * a.p;
  vreal hq = h * a.q;
  sums.hp += hp;
  sums.hq += hq;
  sums.hpp += hp * a.p;
  sums.hpq += hp * a.q;
  sums.hqq += hq * a.q;
#else
  (void)h;
#endif
  return sums;
}

// Sums over pixels -> gradient of the projected splat: v_x = xp hp, v_y = yp hp + yq hq, W = square (hpp, hpq, hqq),
// v_beta = ln 2 log_beta; the others are the sums themselves.
typedef struct {
  real xp, yp, yq, square;
} BlendFactors;

UBS_FN BlendFactors blend_factors(BlendSplat s) {
  BlendFactors f;
  if (UBS_FALLOFF == UBS_FALLOFF_GAUSSIAN) s.beta = R(0.5);
  real twice = R(-2.0) * s.beta;
  f.xp = twice * s.l00;
  f.yp = twice * s.l01;
  f.yq = twice * s.l11;
  f.square = s.beta;
  return f;
}
