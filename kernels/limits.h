// SPDX-License-Identifier: Apache-2.0
// Thresholds of the method, each with its reason. Numbers that the user may change are arguments.
#pragma once

// `what` for each number of dimensions.
#define UBS_EACH_N(what) what(3) what(4) what(5) what(6) what(7) what(8) what(9) what(10) what(11)

// Largest alpha of one splat at one pixel: keeps 1 - alpha >= 1e-3, so backward may divide by it.
#define UBS_ALPHA_MAX R(0.999)
// With a Gaussian kernel as in 3D Gaussian splatting: its largest alpha, and the alpha below which a
// splat is left out at a pixel.
#define UBS_ALPHA_MAX_GAUSSIAN R(0.99)
#define UBS_ALPHA_MIN_GAUSSIAN R(0.00392156862745098)
// Opacity factor exp(-lambda y.y) of beta_opacity gaussian: the lambda of 6D Gaussian splatting.
#define UBS_GAUSSIAN_LAMBDA R(0.35)
// Transmittance at or below which a pixel is finished; the splat that would reach it is left out.
#define UBS_TRANSMITTANCE_MIN R(1e-4)
// 1 - r is not taken smaller than this in the slope of (1-r)^beta, which is unbounded at the rim for beta
// < 1. Values, and derivatives to beta, are exact up to the rim. 1 - r is rounded by 1.7e-7, and gradients of
// a footprint stay within 1e-3 from about 3e-6 on (docs/results/2026-11-20-stability-sweeps.md, `rim`).
#define UBS_RIM R(1e-5)
// ln(2^-23): floor of ln(1 - tanh(u)), parity with the published clamp (method.md 2.4).
#define UBS_LN_EPS R(-15.942385152878742)
// u = y^2 is cut here: far beyond the floor (u = 8.3), far below the overflow of exp(2u) or y^2.
#define UBS_U_MAX R(1e4)
// Raw spatial beta above which beta = 4 exp(raw) stays what it is there, 7.2e3: what is to be seen of a
// support is 1/sqrt(beta) of it, and the rounding of image coordinates is 1e-3 of that from beta = 9e4 on
// (docs/results/2026-11-20-stability-sweeps.md, `beta`).
#define UBS_BETA_RAW_MAX R(7.5)
// A query scale is at least this times the rest of its row of [Lqx, Lq] (the pivot floor of method.md 3.5, on
// the parameter): over its life a splat's path is at most 167 times its size. With it the sweeps `coupled` to
// `coupled_time` of seeds 1 to 10 stay within 8.1e-4, with 3e-3 1.4e-3, with 1e-3 1.2e-2
// (docs/results/2026-11-20-stability-sweeps.md).
#define UBS_QUERY_SCALE_RELATIVE R(6e-3)
// The same in mode whiten (`whiten_large`, `whiten_mixed` of seeds 1 to 20: 1.2e-3 with 6e-3, 7.3e-4 with
// 8e-3).
#define UBS_QUERY_SCALE_WHITEN R(1.2e-2)
// Where a query scale is below this part of its row, and its weight is less than UBS_COUPLED_WEIGHT below 1,
// the conditional covariance comes from its factor (conditional.h). I - U^T Y is known to 1e-7 of 1, which is
// 1e-4 of the square of the ratio.
#define UBS_COUPLED_RELATIVE R(0.03)
#define UBS_COUPLED_WEIGHT R(1e-3)
// Largest K' (sum of the sizes of its entries) with which that is done: K' is known to 1e-7 of it in every
// direction. Without a limit one random case in 160 fails, with 200 one in 10 000; with 100 `coupled_weights`
// has 2.3e-3 (docs/results/2026-11-20-stability-sweeps.md).
#define UBS_COUPLED_SHRINK R(120.0)
// Direct form: rows of the precision's factor L that are longer than this get the direction to its last digit (splat.h).
// The mean moves by L L^T x: half an ulp of x is 6e-8, and 5e-5 of the splat's size from here on.
#define UBS_DIRECT_SHARP R(30.0)
// A spatial scale is at least this times the largest of the three. A needle seen nearly from its end is as
// ill-conditioned as it is long: half an ulp moves its point by 6e-8 of its length. With 1e-4 the sweeps of
// needles of seeds 1 to 40 stay within 8.5e-4, with 5e-5 1.3e-3, with 3e-5 7.4e-3, without it 9.9e-3
// (docs/results/2026-11-20-stability-sweeps.md).
#define UBS_NEEDLE_RELATIVE R(1e-4)
// The same of the diagonal of cov_param cholesky, which is not the ratio of axes (`cholesky_needle`: 1.8e-3
// with 1e-4).
#define UBS_NEEDLE_CHOLESKY R(3e-4)
// skew_nd: a spatial scale is at least this times the largest of the three. With 1e-4 one of ten runs of
// `skew_needle` loses 1e-3, with 1e-3 none 2e-4 (docs/results/2026-11-20-stability-sweeps.md).
#define UBS_SKEW_SCALE_RELATIVE R(1e-3)
// skew_nd: and at least this times the query columns of its row of (I + A) diag(s). K is known to 1e-7 there:
// 1e-3 is lost from 3e-3 on (docs/results/2026-11-20-stability-sweeps.md, `skew_motion`).
#define UBS_SKEW_MOTION_RELATIVE R(1.5e-2)
// Least pivot of the query factor: only rows of zeros have less.
#define UBS_PIVOT_ABSOLUTE R(1e-30)
// An ellipse whose determinant is at most this part of what the blur adds to it is not drawn: its conditional
// covariance is indefinite (mode upper), and the determinant what is left of two numbers that
// cancel. The published test has 0.
#define UBS_DEFINITE R(0.1)
// Distance camera - splat below which the view direction is no longer normalised.
#define UBS_RHO_MIN R(1e-12)
// Frustum limit of the projection's linearisation beyond the image border, in half image widths.
#define UBS_FRUSTUM_MARGIN R(0.3)
// A splat whose raw parameters, as one vector, are longer than this or not finite is not drawn: products of
// three such numbers, which its gradient has, are beyond single precision.
#define UBS_RAW_MAX R(1e12)
// Opacity at or below which a splat counts as dead (MCMC), also the floor after relocation.
#define UBS_OPACITY_DEAD R(0.005)
// Scale at or below which its gradient is 0: it is a quotient by the scale, and the slope of softplus makes
// what is left of it smaller than single precision.
#define UBS_SCALE_MIN R(1e-30)
// Blur compensation below which its derivative is bounded (a splat far below a pixel).
#define UBS_COMPENSATION_MIN R(1e-6)
// Added to the exact footprint against single-precision rounding of its own bounds [px].
#define UBS_FOOTPRINT_MARGIN R(1e-3)
