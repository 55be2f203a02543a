// SPDX-License-Identifier: Apache-2.0
// Determines which blocks of 4x4 pixels in a tile are reached by a splat. Each lane of a vector processes one splat. A
// splat reaches a block if r < `reach` at a point of the rectangle that the block's pixel centres span. r is the
// squared distance to the mean (math/blend.h), and `reach` is the r at which the support ends, or at which alpha
// becomes too small to contribute to a pixel. The test computes the smallest r over the rectangle, so it is exact
// except for the margin UBS_CULL_MARGIN.
// d is the mean of the splat minus a point. In a block, each coordinate of d has values from c - 1.5 to c + 1.5, where
// c is its value at the centre of the block.
#pragma once

// r is compared with reach * (1 + margin). The margin covers the rounding errors of r here and in blend_alpha(), which
// are below 1e-4 of r if the axes of the ellipse have a ratio of 1000 : 1. It enlarges the radius by 0.5 %.
#define UBS_CULL_MARGIN R(0.01)

// CullSplat holds the values of a splat that the test reads. Each lane of a vector belongs to one splat.
typedef struct {
  vreal x, y;           // mean relative to the tile's corner [px]
  vreal l00, l01, l11;  // factor of the conic
  vreal slope_x;         // -L01 / L00; for a given d_y, r is smallest at d_x = slope_x d_y
  vreal slope_y;         // -L00 L01 / (L01^2 + L11^2); for a given d_x, r is smallest at d_y = slope_y d_x
  vreal reach;          // includes the margin
} CullSplat;

UBS_FN CullSplat cull_splat(vreal x, vreal y, vreal l00, vreal l01, vreal l11, vreal reach) {
  CullSplat s;
  s.x = x;
  s.y = y;
  s.l00 = l00;
  s.l01 = l01;
  s.l11 = l11;
  s.slope_x = -l01 / l00;
  s.slope_y = -l00 * l01 / (l01 * l01 + l11 * l11);
  s.reach = reach * (R(1.0) + UBS_CULL_MARGIN);
  return s;
}

// CullSpan is the part of the test that depends on one coordinate only. It consists of the interval of d in the block,
// and of the value in this interval that is closest to 0.
typedef struct {
  vreal low, high, nearest;
} CullSpan;

UBS_FN vreal cull_clamp(vreal value, vreal low, vreal high) { return ubs_max(ubs_min(value, high), low); }

// Returns the span of one coordinate. `mean` and `centre` are this coordinate of the splat's mean and of the block's
// centre, relative to the tile's corner.
UBS_FN CullSpan cull_span(vreal mean, real centre) {
  CullSpan s;
  vreal d = mean - centre;
  s.low = d - R(1.5);  // half the span of the pixel centres of a block
  s.high = d + R(1.5);
  s.nearest = cull_clamp(V(0.0), s.low, s.high);
  return s;
}

// Returns whether the splat reaches the block. r is a convex function. If the mean is inside the rectangle, the minimum
// of r is at the mean. Otherwise the minimum is on one of the edges that face the mean, of which there are at most two.
// On one of them d_x = x.nearest, on the other one d_y = y.nearest. The function computes the minimum on each of these
// two lines within the rectangle, and compares the smaller one with `reach`.
UBS_FN vmask cull_meets(CullSplat s, CullSpan x, CullSpan y) {
  vreal dx = cull_clamp(s.slope_x * y.nearest, x.low, x.high);
  vreal p = s.l00 * dx + s.l01 * y.nearest;
  vreal q = s.l11 * y.nearest;
  vreal r = p * p + q * q;
  vreal dy = cull_clamp(s.slope_y * x.nearest, y.low, y.high);
  p = s.l00 * x.nearest + s.l01 * dy;
  q = s.l11 * dy;
  vreal other = p * p + q * q;
  return ubs_min(r, other) < s.reach;
}
