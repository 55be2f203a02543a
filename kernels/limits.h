// SPDX-License-Identifier: Apache-2.0
// Fixed thresholds of the method, each with its reason. Numbers that the user can change are arguments of the kernels
// instead.
#pragma once

// Expands the macro `what` once for each supported number of dimensions.
#define UBS_EACH_N(what) what(3) what(4) what(5) what(6) what(7) what(8) what(9) what(10) what(11)

// Largest alpha of one splat at one pixel. It keeps 1 - alpha >= 1e-3, so that the backward pass may divide by
// 1 - alpha.
#define UBS_ALPHA_MAX R(0.999)
// The values for the Gaussian kernel, which are those of 3D Gaussian Splatting: the largest alpha, and the alpha
// (1/255) below which a splat is skipped at a pixel.
#define UBS_ALPHA_MAX_GAUSSIAN R(0.99)
#define UBS_ALPHA_MIN_GAUSSIAN R(0.00392156862745098)
// Factor lambda of the opacity factor exp(-lambda y.y) with `beta_opacity gaussian`; the value is that of 6D Gaussian
// Splatting.
#define UBS_GAUSSIAN_LAMBDA R(0.35)
// A pixel is finished when its transmittance would fall to this value or below. The splat that would cause this is
// skipped.
#define UBS_TRANSMITTANCE_MIN R(1e-4)
// Lower bound of 1 - r in the slope of (1 - r)^beta, because for beta < 1 the slope is unbounded at the rim of the
// support. Only the slope is bounded; values and derivatives with respect to beta are exact up to the rim. The rounding
// error of 1 - r is 1.7e-7. If the bound is about 3e-6 or larger, gradients of a whole footprint stay within 1e-3 of
// the exact ones (docs/results/2026-11-20-stability-sweeps.md, `rim`).
#define UBS_RIM R(1e-5)
// ln(2^-23), the lower bound of ln(1 - tanh(u)). It equals the clamp of the published code (method.md 2.4).
#define UBS_LN_EPS R(-15.942385152878742)
// Upper bound of u = y^2. It is far above u = 8.3, where the factor reaches its lower bound, and far below the values
// for which exp(2u) or y^2 overflow.
#define UBS_U_MAX R(1e4)
// Upper bound of the raw spatial beta. With it, beta = 4 exp(raw) is at most 7.2e3. The larger beta is, the smaller is
// the visible part of the support: its size is that of the support divided by sqrt(beta). For beta of 9e4 and more, the
// rounding error of image coordinates exceeds 1e-3 of the size of the visible part
// (docs/results/2026-11-20-stability-sweeps.md, `beta`).
#define UBS_BETA_RAW_MAX R(7.5)
// A query scale is at least this factor times the length of the rest of its row of [Lqx, Lq]. (This is the lower bound
// of the pivots of method.md 3.5, applied to the parameter.) Without this bound, a splat could move by more than 167
// times its own size while the query passes through its support. The value was chosen with the sweeps `coupled` to
// `coupled_time` and the seeds 1 to 10. Their largest error is 8.1e-4 with this value. It is 1.4e-3 with a factor of
// 3e-3, and 1.2e-2 with a factor of 1e-3 (docs/results/2026-11-20-stability-sweeps.md).
#define UBS_QUERY_SCALE_RELATIVE R(6e-3)
// The same factor for models with `cov_mode whiten`. The largest error of the sweeps `whiten_large` and `whiten_mixed`
// is 1.2e-3 with a factor of 6e-3, 7.3e-4 with 8e-3, and 2.2e-4 with this value.
#define UBS_QUERY_SCALE_WHITEN R(1.2e-2)
// A splat is strongly coupled if a query scale is below UBS_COUPLED_RELATIVE times the rest of its row, and if the
// weight of that dimension is above 1 - UBS_COUPLED_WEIGHT. The conditional covariance of such a splat is computed from
// its factor (conditional.h), because I - U^T Y has an absolute error of 1e-7. Compared with the square of
// UBS_COUPLED_RELATIVE, this is already a relative error of 1e-4.
#define UBS_COUPLED_RELATIVE R(0.03)
#define UBS_COUPLED_WEIGHT R(1e-3)
// The factor is used only while the sum of the absolute entries of K' is below this limit (the sum is 3 for K' = I).
// In every direction, K' has an error of 1e-7 times this sum, but the splat that K' is applied to is very thin in one
// direction. The limit was chosen with 30 000 random models with strong coupling and query weights below 1. The table
// shows how many of them fail with exact divisions, and with divisions that have errors of 3 ulp
// (docs/results/2026-11-28-disturbed-division.md).
//   limit                          120   30    8    4
//   failures, exact divisions       58   15    3    2
//   failures, divisions of 3 ulp   302   94   29   21
#define UBS_COUPLED_SHRINK R(4.0)
// This limit applies to direct conditioning. If a row of the precision's factor L is longer than the limit, the view
// direction x is computed with a correction for its rounding errors (direction_rest() of splat.h). The mean of the
// splat moves by L L^T x. An error of half an ulp in x (6e-8) moves the mean by 5e-5 of the size of the splat if the
// rows have this length, and by more if they are longer.
#define UBS_DIRECT_SHARP R(30.0)
// A spatial scale is at least this factor times the largest of the three. A needle that is seen nearly from its end is
// ill-conditioned in proportion to its length: half an ulp moves its tip by 6e-8 of the length. The largest error of
// the sweeps of needles with the seeds 1 to 40 is 8.5e-4 with a factor of 1e-4, 1.3e-3 with 5e-5, and 7.4e-3 with 3e-5.
// Without a bound it is 9.9e-3 (docs/results/2026-11-20-stability-sweeps.md).
#define UBS_NEEDLE_RELATIVE R(1e-4)
// The same bound for the diagonal of models with `cov_param cholesky`. It is larger, because ratios of the diagonal are
// not the ratios of the axes. (With 1e-4 the sweep `cholesky_needle` has an error of 1.8e-3.)
#define UBS_NEEDLE_CHOLESKY R(3e-4)
// In models with `cov_param skew_nd`, a spatial scale is at least this factor times the largest of the three. With a
// factor of 1e-4, one of ten runs of the sweep `skew_needle` has an error of 1e-3. With 1e-3, the error of every run is
// at most 2e-4 (docs/results/2026-11-20-stability-sweeps.md).
#define UBS_SKEW_SCALE_RELATIVE R(1e-3)
// In models with `cov_param skew_nd`, a spatial scale is also at least this factor times the length of the query
// columns of its row of (I + A) diag(s), because K has an absolute error of 1e-7 for such models. The largest error of
// the sweep `skew_motion` is 0.48 without this bound, 1.2e-3 with a factor of 1e-2, and 4.7e-4 with a factor of 1.5e-2
// (docs/results/2026-11-20-stability-sweeps.md).
#define UBS_SKEW_MOTION_RELATIVE R(1.5e-2)
// Lower bound of the pivots of the query factor. Only rows of zeros have smaller pivots.
#define UBS_PIVOT_ABSOLUTE R(1e-30)
// An ellipse is not rendered if its determinant is at most this fraction of the amount that the blur adds to the
// determinant. In this case its conditional covariance is indefinite (which is possible with `cov_mode upper`), and its
// determinant is the difference of two numbers that nearly cancel. The published code compares with 0.
#define UBS_DEFINITE R(0.1)
// If the distance between the camera and the splat is below this value, the view direction is not normalised.
#define UBS_RHO_MIN R(1e-12)
// The linearisation of the projection is clamped at this distance outside the image, in units of half the image width.
#define UBS_FRUSTUM_MARGIN R(0.3)
// A splat is not rendered if the vector of its raw parameters is longer than this or not finite, because its gradient
// contains products of three such parameters, which would exceed the range of single precision.
#define UBS_RAW_MAX R(1e12)
// A splat with this opacity or less counts as dead (MCMC). It is also the lower bound of opacities after relocation.
#define UBS_OPACITY_DEAD R(0.005)
// The gradient of a scale is 0 if the scale is at most this value. The gradient contains a division by the scale, and
// after the multiplication with the slope of softplus the result is below the range of single precision.
#define UBS_SCALE_MIN R(1e-30)
// Lower bound of the blur compensation in the formula of its derivative. The compensation of a splat that is far
// smaller than a pixel is below this value.
#define UBS_COMPENSATION_MIN R(1e-6)
// Lower bound of the blur compensation of Gaussians in arrays of the program (UBS_GAUSSIAN_ARRAYS). It is the one of
// gsplat, so that images are the same; a Gaussian with this compensation is hardly visible.
#define UBS_COMPENSATION_ARRAYS R(0.005)
// The footprint of a splat is enlarged by this margin [px], because its bounds are rounded to single precision.
#define UBS_FOOTPRINT_MARGIN R(1e-3)
// The depth of a pixel has no gradient if its alpha is at most this value.
#define UBS_FAINTEST_ALPHA R(1e-6)
// The gradient of alpha is passed to the rasteriser in a colour channel. If the gradients of all colours of a pixel are
// smaller than this share of the gradient of alpha (2^-30), one of them is set to it. This adds a relative error of
// 1e-9. The value that is set is at least UBS_ALPHA_GRADIENT_MIN, twice the smallest normal number, so that it does not
// become 0 on devices without denormals. This concerns gradients of alpha below 2.6e-29, which have a larger relative
// error.
#define UBS_ALPHA_GRADIENT_SHARE R(9.3132257e-10)
#define UBS_ALPHA_GRADIENT_MIN R(2.4e-38)
