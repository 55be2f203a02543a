// SPDX-License-Identifier: Apache-2.0
// Determines which 4x4 pixel blocks of a tile a splat reaches (lanes are splats). A splat reaches a block if
// r < `reach` at a point of the rectangle that the block's pixel centres span. r is the squared distance to the mean,
// and `reach` is the r at which the support ends, or at which alpha falls below its limit. The test is exact up to
// UBS_CULL_MARGIN: it computes the smallest r over the rectangle.
// d is the mean of the splat minus a point. Over a block, d runs over [c - 1.5, c + 1.5] in x and in y, where c is its
// value at the centre of the block.
#pragma once

// r is compared with reach * (1 + margin). The margin covers the rounding of r here and in blend_alpha() (relative
// error below 1e-4 for axes of 1000 : 1), and enlarges the radius by 0.5 %.
#define UBS_CULL_MARGIN R(0.01)

// The values of a splat that the test reads; lanes are splats.
typedef struct {
  vreal x, y;           // mean relative to the tile's corner [px]
  vreal l00, l01, l11;  // factor of the conic
  vreal lean_x;         // for a given d_y, r is smallest at d_x = lean_x d_y: -L01 / L00
  vreal lean_y;         // for a given d_x, r is smallest at d_y = lean_y d_x: -L00 L01 / (L01^2 + L11^2)
  vreal reach;          // includes the margin
} CullSplat;

UBS_FN CullSplat cull_splat(vreal x, vreal y, vreal l00, vreal l01, vreal l11, vreal reach) {
  CullSplat s;
  s.x = x;
  s.y = y;
  s.l00 = l00;
  s.l01 = l01;
  s.l11 = l11;
  s.lean_x = -l01 / l00;
  s.lean_y = -l00 * l01 / (l01 * l01 + l11 * l11);
  s.reach = reach * (R(1.0) + UBS_CULL_MARGIN);
  return s;
}

// The part of the test that depends on one coordinate only: the interval of d, and the point of it that is closest to
// 0.
typedef struct {
  vreal low, high, nearest;
} CullSpan;

UBS_FN vreal cull_clamp(vreal value, vreal low, vreal high) { return ubs_max(ubs_min(value, high), low); }

// centre: centre of the block in this coordinate, relative to the tile's corner.
UBS_FN CullSpan cull_span(vreal mean, real centre) {
  CullSpan s;
  vreal d = mean - centre;
  s.low = d - R(1.5);  // half the span of the pixel centres of a block
  s.high = d + R(1.5);
  s.nearest = cull_clamp(V(0.0), s.low, s.high);
  return s;
}

// Returns whether the splat reaches the block. r is convex. If the mean is inside the rectangle, the minimum of r is
// there. Otherwise it is on one of the (at most two) edges that face the mean: at d_x = nearest or at d_y = nearest,
// with the other coordinate free in its interval. Both candidates are points of the rectangle.
UBS_FN vmask cull_meets(CullSplat s, CullSpan x, CullSpan y) {
  vreal dx = cull_clamp(s.lean_x * y.nearest, x.low, x.high);
  vreal p = s.l00 * dx + s.l01 * y.nearest;
  vreal q = s.l11 * y.nearest;
  vreal r = p * p + q * q;
  vreal dy = cull_clamp(s.lean_y * x.nearest, y.low, y.high);
  p = s.l00 * x.nearest + s.l01 * dy;
  q = s.l11 * dy;
  vreal other = p * p + q * q;
  return ubs_min(r, other) < s.reach;
}
