// SPDX-License-Identifier: Apache-2.0
// The textbook evaluation of math/blend.h, with its interface and for the Beta kernel only: r by the conic's entries,
// 1 - r before its logarithm, (1-r)^(beta-1) unguarded, gradients of the conic from sums in pixels. Only `ubs sweep`
// compiles it. Here l00, l01, l11 hold the conic (Q00, Q01, Q11) itself.
#ifndef UBS_NAIVE_BLEND_H
#define UBS_NAIVE_BLEND_H

typedef struct {
  real l00, l01, l11;  // the conic
  real opacity, beta;
  real r, g, b;
} BlendSplat;

typedef struct {
  vreal dx, dy, r, log_1mr, falloff, alpha;
  vmask inside, capped;
} BlendAlpha;

UBS_FN BlendAlpha blend_alpha(BlendSplat s, vreal dx, vreal dy) {
  BlendAlpha a;
  a.dx = dx;
  a.dy = dy;
  a.r = s.l00 * dx * dx + R(2.0) * s.l01 * dx * dy + s.l11 * dy * dy;
  a.inside = (a.r >= V(0.0)) & (a.r < V(1.0));
  vreal r = a.inside ? a.r : V(0.0);
  a.log_1mr = ubs_log(V(1.0) - r);
  a.falloff = ubs_exp(s.beta * a.log_1mr);
  vreal raw = s.opacity * a.falloff;
  a.capped = raw > (vreal)(UBS_ALPHA_MAX);
  raw = a.capped ? (vreal)(UBS_ALPHA_MAX) : raw;
  a.alpha = a.inside ? raw : V(0.0);
  return a;
}

// Transmittance behind the splat and the splat's weight alpha * T. A pixel that the splat would
// finish takes nothing of it and is closed: its `open` transmittance becomes 0 from then on.
typedef struct {
  vreal weight;
  vreal open;        // transmittance if the pixel goes on, else 0
  vmask composited;  // the splat is part of the pixel
} BlendStep;

UBS_FN BlendStep blend_step(BlendAlpha a, vreal open) {
  BlendStep s;
  vreal next = open - open * a.alpha;
  s.composited = next > (vreal)(UBS_TRANSMITTANCE_MIN);
  s.weight = s.composited ? open * a.alpha : V(0.0);
  s.open = s.composited ? next : V(0.0);
  return s;
}

typedef struct {
  vreal hp, hq, hpp, hpq, hqq;  // v_r dx, v_r dy, v_r dx^2, v_r dx dy, v_r dy^2
  vreal opacity, log_beta, r, g, b;
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

UBS_FN BlendSums blend_vjp(BlendSums sums, BlendSplat s, BlendAlpha a, BlendStep step, vreal open, vreal remaining,
                           vreal v_r, vreal v_g, vreal v_b) {
  sums.r += step.weight * v_r;
  sums.g += step.weight * v_g;
  sums.b += step.weight * v_b;
  vreal v_alpha = open * (s.r * v_r + s.g * v_g + s.b * v_b) - remaining / (V(1.0) - a.alpha);
  v_alpha = (step.composited & a.inside & !a.capped) ? v_alpha : V(0.0);
  sums.opacity += a.falloff * v_alpha;
  sums.log_beta += a.alpha * v_alpha * a.log_1mr;
  vreal v_radius = -v_alpha * s.opacity * s.beta * ubs_exp((s.beta - R(1.0)) * a.log_1mr);
  v_radius = a.inside ? v_radius : V(0.0);
  sums.hp += v_radius * a.dx;
  sums.hq += v_radius * a.dy;
  sums.hpp += v_radius * a.dx * a.dx;
  sums.hpq += v_radius * a.dx * a.dy;
  sums.hqq += v_radius * a.dy * a.dy;
  return sums;
}

#endif
