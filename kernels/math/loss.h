// SPDX-License-Identifier: Apache-2.0
// Computes the image loss at one pixel (method.md 4.1), for an image x and a target t. SSIM is expressed in u = x + t
// and v = x - t. With the window means U, V and the window variances su, sv of u and v,
//   (2 mx mt + C1) / (mx^2 + mt^2 + C1) = 1 - V^2 / Cc,   Cc = (U^2 + V^2) / 2 + C1
//   (2 cov + C2) / (var x + var t + C2) = 1 - sv / Dd,    Dd = (su + sv) / 2 + C2
// So four window sums are enough instead of five, 1 - SSIM is computed without cancellation, and the large factor
// 1 / C2 of the gradient multiplies the difference x - t instead of x and t separately.
#pragma once

#define UBS_SSIM_C1 R(1e-4)
#define UBS_SSIM_C2 R(9e-4)
enum {
  kSsimRadius = 5,
  kSsimTaps = 2 * kSsimRadius + 1,
};
// The taps exp(-k^2 / 4.5), divided by their sum. The weight of a pixel in the window is the product of the tap for its
// column and the tap for its row.
#define UBS_SSIM_WEIGHTS                                                                                \
  {                                                                                                     \
    R(0.00102838008447911), R(0.00759875813523919), R(0.03600077212843083), R(0.10936068950970002),     \
        R(0.21300553771125370), R(0.26601172486179436), R(0.21300553771125370), R(0.10936068950970002), \
        R(0.03600077212843083), R(0.00759875813523919), R(0.00102838008447911)                          \
  }

// The means of u, v, u^2 and v^2 over a window, where 2 * shift has been subtracted from u. The variance does not
// depend on the shift; a shift near the values of the pixels avoids cancellation.
typedef struct {
  vreal u, v, uu, vv;
} SsimMeans;

// The dissimilarity 1 - SSIM of a window, and the values of the window from which the gradient is computed. If K
// denotes the blur with the window,
//   d SSIM / d x_j = (K mean)_j + 2 u_j (K square_u)_j + 2 v_j (K square_v)_j.
typedef struct {
  vreal dissimilarity;
  vreal mean, square_u, square_v;
} SsimPoint;

// Computes SsimPoint from the means of a window. In exact arithmetic Dd is never below C2. The variable d is clamped,
// so that rounding cannot make it smaller.
UBS_FN SsimPoint ssim_point(SsimMeans m, real shift) {
  SsimPoint p;
  vreal var_v = m.vv - m.v * m.v;
  vreal d = R(0.5) * (m.uu - m.u * m.u + var_v) + UBS_SSIM_C2;
  d = d < (vreal)(UBS_SSIM_C2) ? (vreal)(UBS_SSIM_C2) : d;
  vreal u = m.u + R(2.0) * shift;
  vreal c = R(0.5) * (u * u + m.v * m.v) + UBS_SSIM_C1;
  vreal inverse_c = V(1.0) / c;
  vreal inverse_d = V(1.0) / d;
  vreal far = m.v * m.v * inverse_c;  // 1 - luminance term
  vreal unlike = var_v * inverse_d;   // 1 - structure term
  vreal luminance = V(1.0) - far;
  vreal structure = V(1.0) - unlike;
  p.dissimilarity = far + unlike - far * unlike;
  vreal luminance_u = far * (u * inverse_c);
  vreal luminance_v = (m.v * inverse_c) * (far - V(2.0));
  p.square_u = R(0.5) * luminance * unlike * inverse_d;
  p.square_v = p.square_u - luminance * inverse_d;
  p.mean = structure * (luminance_u + luminance_v) - R(2.0) * (p.square_u * u + p.square_v * m.v);
  return p;
}

// The quantities that are summed over the pixels: the terms of the loss, and the squared difference, which is reported
// but not part of the loss. To add a term to the loss, append its quantity. Then the stage ImageLoss writes the mean of
// the quantity to element 5 of its sums. There may be at most four quantities (LOSS_TILE_SUMS).
enum { kLossL1, kLossDissimilarity, kLossSquare, kLossQuantities };
typedef struct {
  vreal of[kLossQuantities];
} LossQuantities;

UBS_FN LossQuantities loss_quantities(vreal v, SsimPoint point) {
  LossQuantities q;
  q.of[kLossL1] = ubs_fabs(v);
  q.of[kLossDissimilarity] = point.dissimilarity;
  q.of[kLossSquare] = v * v;
  return q;
}

// Returns the derivative of the loss with respect to x, from the blurred maps of ssim_point(). The weights are already
// divided by the number of values. The slope of |v| at 0 is defined as 0.
UBS_FN vreal image_loss_vjp(LossWeights k, vreal u, vreal v, vreal mean, vreal square_u, vreal square_v) {
  vreal sign = v > V(0.0) ? V(1.0) : (v < V(0.0) ? V(-1.0) : V(0.0));
  return k.l1 * sign - k.dssim * (mean + R(2.0) * (u * square_u + v * square_v));
}
