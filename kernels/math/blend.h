// SPDX-License-Identifier: Apache-2.0
// The functions of this file blend one splat into one pixel (method.md 2.6, 3.1). They compute the spatial kernel,
// alpha, the front-to-back compositing, and the gradients of these. All rasterisers use them. The lanes of a vector are
// pixels, and d is the mean of the splat minus the pixel centre.
// falloff.h contains the formulas of the kernel F. If UBS_ALPHA_MIN is above 0, a splat contributes only to pixels in
// which its alpha exceeds this limit.
// If one of the macros UBS_NO_V_SHAPE (mean and conic), UBS_NO_V_OPACITY, UBS_NO_V_BETA and UBS_NO_V_COLOUR is defined,
// the corresponding gradient is not computed, and its sums stay zero.
#pragma once

// BlendSplat holds the values of a splat that blending reads. They are the same for all pixels of a block.
typedef struct {
  real l00, l01, l11;  // factor of the conic
  real opacity, beta;
  real r, g, b;
} BlendSplat;

// BlendAlpha holds the alpha of a splat at a pixel, and the values from which it is computed.
typedef struct {
  vreal p, q;      // L d: the offset in the coordinates of the ellipse
  // p^2 + q^2, the squared distance from the mean, after falloff_near(). The unit of the distance is the radius of the
  // support, or the standard deviation for a Gaussian.
  vreal r;
  vreal begun;     // result of falloff_begin()
  vreal falloff;   // the value of the kernel
  vreal alpha;     // 0 outside the support
  // True if the pixel is in the support of the kernel and alpha is within the limits described above.
  vmask inside;
  vmask passes;    // `inside`, and alpha was not reduced to its maximum, so that its gradient is not zero
} BlendAlpha;

// blend_begin() and blend_end() are the two halves of blend_alpha() and take about the same time. Rasterisers that
// start a splat before they finish the previous one call them separately. The first half fills p, q, r, begun and
// inside.
UBS_FN BlendAlpha blend_begin(BlendSplat s, vreal dx, vreal dy) {
  BlendAlpha a;
  a.p = ubs_fma((vreal)(s.l00), dx, s.l01 * dy);
  a.q = s.l11 * dy;
  a.r = ubs_fma(a.p, a.p, a.q * a.q);
  a.inside = a.r < (vreal)(UBS_SUPPORT);
  a.r = falloff_near(a.r);
  a.begun = falloff_begin(a.r, s.beta);
  a.falloff = a.alpha = V(0.0);
  a.passes = a.inside;
  return a;
}
UBS_FN BlendAlpha blend_end(BlendSplat s, BlendAlpha a) {
  // The exponent is set to 0 outside the support, so that falloff is 1 there. Values near 0 would produce denormal
  // products, which cost CPUs a quarter of the time of the rasteriser.
  vreal exponent = falloff_exponent(a.begun, a.r, s.beta);
  a.falloff = ubs_exp2(a.inside ? exponent : V(0.0));
  vreal raw = s.opacity * a.falloff;
  if (UBS_KERNEL_ALPHA_MIN > R(0.0)) a.inside = a.inside & (raw >= (vreal)(UBS_KERNEL_ALPHA_MIN));
  vreal most = (vreal)(UBS_KERNEL_ALPHA_MAX);
  vmask capped = raw > most;
  raw = capped ? most : raw;
  if (UBS_ALPHA_MIN > R(0.0)) a.inside = a.inside & (raw > (vreal)(UBS_ALPHA_MIN));
  a.passes = a.inside & !capped;
  a.alpha = a.inside ? raw : V(0.0);
  return a;
}

UBS_FN BlendAlpha blend_alpha(BlendSplat s, vreal dx, vreal dy) { return blend_end(s, blend_begin(s, dx, dy)); }

// BlendStep is the result of one compositing step. If the transmittance after the splat would be at most
// UBS_TRANSMITTANCE_MIN, the splat is skipped and the pixel is closed: its value `open` becomes 0 and stays 0.
typedef struct {
  vreal weight;      // weight of the splat's colour: alpha times the transmittance in front of the splat
  vreal open;        // transmittance if the pixel stays open, otherwise 0
  vmask composited;  // the splat contributes to the pixel
} BlendStep;

UBS_FN BlendStep blend_step(BlendAlpha a, vreal open) {
  BlendStep s;
  vreal next = ubs_fma(-open, a.alpha, open);
  s.composited = next > (vreal)(UBS_TRANSMITTANCE_MIN);
  s.weight = s.composited ? open * a.alpha : V(0.0);
  s.open = s.composited ? next : V(0.0);
  return s;
}

// Returns the mean depth of the composited splats, from sum(weight z) and sum(weight), or 0 if there are none.
UBS_FN vreal blend_expected_depth(vreal weighted_depth, vreal weight) {
  return weighted_depth / ubs_max(weight, V(1e-10));
}

// BlendSums holds sums over pixels from which the gradient of a splat is computed. They do not contain the factors that
// are the same for all pixels; blend_factors() returns these factors, which are applied once per splat or tile.
// With k = falloff_factor(), h = -v_alpha * alpha * d(ln F)/dr / k and (p, q) = L d, the gradients of the mean and of
// the ellipse are
//   v_mean = -2 k L^T sum h (p, q),   W = k sum h (p, q) (p, q)^T   (EllipseVjp of ellipse.h).
// The sums use the coordinates (p, q) of the ellipse, with |(p, q)| < 1 inside the support. With sums of h d d^T in
// pixel coordinates, the short axis of a thin ellipse would be lost in the rounding error of the long axis.
typedef struct {
  // Sums of h p, h q, h p^2, h p q and h q^2. With UBS_ABSGRAD the first two are sums of |h p| and |l01 h p + l11 h q|.
  vreal hp, hq, hpp, hpq, hqq;
  vreal opacity;                // falloff * v_alpha
  vreal log_beta;               // alpha v_alpha d(log2 F)/dbeta
  vreal r, g, b;                // weight * v_pixel
} BlendSums;

UBS_FN BlendSums blend_no_sums(void) {
  BlendSums s;
  s.hp = s.hq = s.hpp = s.hpq = s.hqq = s.opacity = s.log_beta = s.r = s.g = s.b = V(0.0);
  return s;
}

// Returns the dot product of the splat's colour and the gradient v of the pixel's colour.
UBS_FN vreal blend_shade(BlendSplat s, vreal v_r, vreal v_g, vreal v_b) { return s.r * v_r + s.g * v_g + s.b * v_b; }

// Returns the dot product of the gradient v of the pixel's colour and the colour that is composited after the splat,
// including the background. `remaining` is the result for the previous splat, and `shade` that of blend_shade().
UBS_FN vreal blend_remaining(BlendStep step, vreal remaining, vreal shade) { return remaining - step.weight * shade; }

// Adds the contribution of the splat at one pixel to `sums`. Each addition is one expression, so that it compiles to
// one fused instruction. `open` is the transmittance in front of the splat, `remaining` and `shade` are the results of
// blend_remaining() and blend_shade() for this splat, and v_r, v_g and v_b are the gradient of the loss with respect to
// the colour of the pixel.
UBS_FN BlendSums blend_vjp(BlendSums sums, BlendSplat s, BlendAlpha a, BlendStep step, vreal open, vreal remaining,
                           vreal shade, vreal v_r, vreal v_g, vreal v_b) {
#ifndef UBS_NO_V_COLOUR
  sums.r += step.weight * v_r;
  sums.g += step.weight * v_g;
  sums.b += step.weight * v_b;
#endif
  vreal one_minus_alpha = V(1.0) - a.alpha;
  FalloffSlopes slopes = falloff_slopes(a.begun, a.r, s.beta, remaining, one_minus_alpha);
  vreal v_alpha = open * shade - slopes.behind;
  v_alpha = (step.composited & a.passes) ? v_alpha : V(0.0);
#ifndef UBS_NO_V_OPACITY
  sums.opacity += a.falloff * v_alpha;
#endif
  vreal h = a.alpha * v_alpha;
#ifndef UBS_NO_V_BETA
  if (kHasSpatialBeta) sums.log_beta += h * slopes.beta;
#endif
  h = h * slopes.r;
#ifndef UBS_NO_V_SHAPE
  vreal hp = h * a.p;
  vreal hq = h * a.q;
#if UBS_ABSGRAD
  sums.hp += ubs_fabs(hp);
  sums.hq += ubs_fabs(s.l01 * hp + s.l11 * hq);
#else
  sums.hp += hp;
  sums.hq += hq;
#endif
  sums.hpp += hp * a.p;
  sums.hpq += hp * a.q;
  sums.hqq += hq * a.q;
#else
  (void)h;
#endif
  return sums;
}

// BlendFactors holds the factors that turn the sums over pixels into the gradient of the projected splat:
// v_x = xp hp, v_y = yp hp + yq hq, W = square (hpp, hpq, hqq) and v_beta = ln 2 log_beta. The other sums are already
// gradients.
typedef struct {
  real xp, yp, yq, square;
} BlendFactors;

UBS_FN BlendFactors blend_factors(BlendSplat s) {
  BlendFactors f;
  s.beta = falloff_factor(s.beta);
  real twice = R(-2.0) * s.beta;
  f.xp = UBS_ABSGRAD ? ubs_fabs(twice * s.l00) : twice * s.l00;
  f.yp = UBS_ABSGRAD ? R(0.0) : twice * s.l01;
  f.yq = UBS_ABSGRAD ? ubs_fabs(twice) : twice * s.l11;
  f.square = s.beta;
  return f;
}
