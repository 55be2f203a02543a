// SPDX-License-Identifier: Apache-2.0
// This file contains the per-splat formulas of the oracle, which compute the footprint of a splat in one
// image from its raw parameters. They follow the text of docs/method.md directly with dense matrices: the
// full N x N factor of the covariance, an orthogonal factorisation of its query rows, and a Gauss-Jordan
// inverse. They are templates over the scalar type of tape.hpp. This file shares no code with the kernels.
// Every branch on a scalar tests value(x), because clamps and decisions to cull depend only on the value and
// are not differentiated.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>
#include <stdexcept>
#include <type_traits>
#include <vector>

#include "host/lab/oracle/matrix.hpp"
#include "host/lab/oracle/oracle.hpp"
#include "host/lab/oracle/tape.hpp"
#include "host/lab/oracle/variant_formula.hpp"
#include "host/scene/camera.hpp"

namespace ubs::oracle {

// Rows contains the row numbers of the raw parameters, in the order of model files. They are computed here
// independently of ParameterLayout, so that tests check its layout. A row exists only if the variant uses it:
// there is no spatial beta with a Gaussian kernel, and there are no query betas if neither the conditioning
// nor the opacity uses them.
struct Rows {
  explicit Rows(int n, const ModelVariant& v = {})
      : dim(n),
        query(n - 3),
        lobes(lobes_of(v.colour)),
        harmonics(lobes ? 1 : bands(v.colour) * bands(v.colour)) {
    if (n < 3) throw std::invalid_argument("oracle: a splat has at least 3 dimensions");
    opacity = rgb + 3 * std::max(1, harmonics) + 6 * lobes;
    beta = opacity + 1;
    query_beta = beta + (v.has_spatial_beta() ? 1 : 0);
    const bool betas = v.beta_cond == BetaCond::on || v.beta_opacity == BetaOpacity::tanh;
    mean = query_beta + (betas ? query : 0);
    scale = mean + query;
    triangle = scale + n;
    count = triangle + (v.rot_mode == RotMode::quaternion ? 4 : n * (n - 1) / 2);
  }
  static int bands(ColourMode mode) { return static_cast<int>(mode); }
  static int lobes_of(ColourMode mode) {
    return mode == ColourMode::sb3 ? 3 : mode == ColourMode::sb2 ? 2 : mode == ColourMode::sb1 ? 1 : 0;
  }
  int dim, query, lobes, harmonics;
  int xyz = 0, rgb = 3, opacity, beta, query_beta, mean, scale, triangle, count;
};

template <class S>
S softplus(const S& x) {
  using std::exp;
  using std::log1p;
  return value(x) > 20 ? x : log1p(exp(x));
}

// Returns the skew-symmetric matrix of packed parameters. The parameters are in the order of the rows of a
// strict lower triangle. As in the published code, they enter the upper triangle with their own sign and the
// lower triangle with the opposite sign.
template <class S>
Matrix<S> skew(std::span<const S> raw, const Rows& rows, int n) {
  Matrix<S> result(n, n);
  for (int i = 1; i < n; ++i)
    for (int j = 0; j < i; ++j) {
      result(j, i) = raw[rows.triangle + i * (i - 1) / 2 + j];
      result(i, j) = -result(j, i);
    }
  return result;
}

// These clamps are documented in kernels/limits.h. They are defined again here, so that the oracle does not
// depend on the kernels. The raw spatial beta is at most kLargestRawBeta. A query scale is at least
// least_query_scale() times the length of the entries to the left of it in its row.
inline constexpr double kLargestRawBeta = 7.5;
inline double least_query_scale(const ModelVariant& variant) {
  return variant.cov_mode == CovMode::whiten ? 1.2e-2 : 6e-3;
}
// Returns the minimum of a spatial scale, relative to the largest spatial scale of the splat.
inline double least_spatial_scale(const ModelVariant& variant) {
  return variant.cov_param == CovParam::skew_nd    ? 1e-3
         : variant.cov_param == CovParam::cholesky ? 3e-4
                                                   : 1e-4;
}
// With skew_nd there is a second clamp after the one above. It uses the rows of (I + A) diag(s). A query
// scale is at least least_query_scale() times the length of the other entries of its row. A spatial scale is
// at least kMinSkewMotion times the length of the entries in the query columns of its row. These lengths are
// computed with the scales before the second clamp.
inline constexpr double kMinSkewMotion = 1.5e-2;

// Returns softplus of the raw spatial scales, raised to the minimum if they are below it. A raised scale is a
// fixed multiple of the largest scale and has the corresponding derivative.
template <class S>
std::array<S, 3> spatial_scales(std::span<const S> raw, const Rows& rows, const ModelVariant& variant) {
  std::array<S, 3> scales;
  for (int j = 0; j < 3; ++j) scales[j] = softplus(raw[rows.scale + j]);
  const S largest = *std::max_element(scales.begin(), scales.end(),
                                      [](const S& a, const S& b) { return value(a) < value(b); });
  const double least = least_spatial_scale(variant);
  for (S& scale : scales)
    if (value(scale) < least * value(largest)) scale = least * largest;
  return scales;
}

// Returns `scale` or, if it is smaller, the minimum of this query scale. The result has the derivative of the
// returned expression.
template <class S>
S query_scale(const S& scale, const Matrix<S>& factor, int row, double ratio) {
  using std::sqrt;
  S square(0);
  for (int j = 0; j < row; ++j) square += factor(row, j) * factor(row, j);
  if (!(value(square) > 0)) return scale;
  const S least = ratio * sqrt(square);
  return value(scale) < value(least) ? least : scale;
}

// Returns all scales of a splat with skew_nd after both clamps. `r` is I + A.
template <class S>
std::vector<S> skew_scales(std::span<const S> raw, const Rows& rows, const Matrix<S>& r,
                           const ModelVariant& variant) {
  using std::sqrt;
  const std::array<S, 3> spatial = spatial_scales(raw, rows, variant);
  std::vector<S> scales(spatial.begin(), spatial.end());
  for (int j = 3; j < rows.dim; ++j) scales.push_back(softplus(raw[rows.scale + j]));
  std::vector<S> result = scales;
  for (int i = 0; i < rows.dim; ++i) {
    const double least = i < 3 ? kMinSkewMotion : least_query_scale(variant);
    S square(0);
    for (int j = i < 3 ? 3 : 0; j < rows.dim; ++j)
      if (j != i) square += r(i, j) * scales[j] * r(i, j) * scales[j];
    if (value(square) > 0 && value(scales[i]) < least * std::sqrt(value(square)))
      result[i] = least * sqrt(square);
  }
  return result;
}

// Returns the N x N factor L of the covariance L L^T. By default it is [[R diag(s_x), 0], [Lqx, Lq]] with the
// rotation R and the spatial scales s_x. With `cholesky` it is a lower triangle, and with `skew_nd` it is (I
// + A) diag(s).
template <class S>
Matrix<S> covariance_factor(std::span<const S> raw, const Rows& rows, const ModelVariant& variant = {}) {
  const int n = rows.dim;
  Matrix<S> result(n, n);
  if (variant.cov_param == CovParam::skew_nd) {
    const Matrix<S> r = Matrix<S>::identity(n) + skew(raw, rows, n);
    const std::vector<S> scales = skew_scales(raw, rows, r, variant);
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j) result(i, j) = r(i, j) * scales[j];
    return result;
  }
  const bool triangular = variant.cov_param == CovParam::cholesky;
  const std::array<S, 3> scales = spatial_scales(raw, rows, variant);
  if (!triangular) {
    const Matrix<S> r = variant.rot_mode == RotMode::quaternion
                            ? quaternion_rotation<S>({raw[rows.triangle], raw[rows.triangle + 1],
                                                      raw[rows.triangle + 2], raw[rows.triangle + 3]})
                            : skew_rotation(skew(raw, rows, 3), variant.rot_mode);
    for (int j = 0; j < 3; ++j)
      for (int i = 0; i < 3; ++i) result(i, j) = r(i, j) * scales[j];
  }
  // With direct conditioning, the rows below the spatial block are not part of a covariance.
  const int last = variant.conditioning == Conditioning::direct ? 3 : n;
  for (int i = triangular ? 0 : 3; i < last; ++i) {
    for (int j = 0; j < i; ++j) result(i, j) = raw[rows.triangle + i * (i - 1) / 2 + j];
    result(i, i) = i < 3 ? scales[i] : softplus(raw[rows.scale + i]);
    if (i >= 3) result(i, i) = query_scale(result(i, i), result, i, least_query_scale(variant));
  }
  return result;
}

inline std::array<double, 3> camera_centre(const Camera& camera) {
  std::array<double, 3> centre{};
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k) centre[i] -= camera.rotation[3 * k + i] * camera.translation[k];
  // If a coordinate differs from a float only by the rounding of double precision, it is replaced by this
  // float, because a splat may have exactly this coordinate.
  const double size =
      std::abs(camera.translation[0]) + std::abs(camera.translation[1]) + std::abs(camera.translation[2]);
  for (double& c : centre)
    if (const double exact = static_cast<float>(c); std::abs(c - exact) < 1e-14 * size) c = exact;
  return centre;
}

// Returns the direction from the camera to the unconditional mean. The direction has a gradient if S is Var,
// and none if S is double.
template <class S>
std::array<S, 3> view_direction(const std::array<S, 3>& position, const Camera& camera) {
  using std::sqrt;
  const std::array<double, 3> centre = camera_centre(camera);
  std::array<S, 3> w{position[0] - centre[0], position[1] - centre[1], position[2] - centre[2]};
  const S square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2];
  const S rho = std::sqrt(value(square)) > 1e-12 ? sqrt(square) : S(1e-12);
  for (S& component : w) component = component / rho;
  return w;
}

// Returns the query of a splat, which has C = N - 3 values. It is (time, extra values) for C = 1 and 2, and
// (view direction, time, extra values) for C >= 3.
template <class S>
std::vector<S> query_vector(std::span<const S> raw, const Rows& rows, const Camera& camera, bool query_grad) {
  std::vector<S> result;
  if (rows.query >= 3) {
    if (query_grad) {
      for (const S& d : view_direction<S>({raw[0], raw[1], raw[2]}, camera)) result.push_back(d);
    } else {
      for (double d : view_direction<double>({value(raw[0]), value(raw[1]), value(raw[2])}, camera))
        result.push_back(S(d));
    }
  }
  const int scalars = rows.query - static_cast<int>(result.size());
  if (scalars > 1 && static_cast<int>(camera.extra.size()) < scalars - 1)
    throw std::invalid_argument("oracle: the camera has too few extra query values for this dimension");
  for (int i = 0; i < scalars; ++i) result.push_back(S(i == 0 ? camera.time : camera.extra[i - 1]));
  return result;
}

// Returns min(exp b, 1). The slope is that of exp for b < 0, and exactly 0 for b >= 0.
template <class S>
S condition_weight(const S& b) {
  using std::exp;
  return value(b) < 0 ? exp(b) : S(1);
}

// y^2 is limited to this value, so that the logarithm of an opacity factor stays finite. The limit does not
// change opacities: at this value, a tanh factor is at its floor, and a Gaussian factor is 0 even in double
// precision.
inline constexpr double kLargestU = 1e4;
inline constexpr double kLowestLogFactor = -15.942385152878742;  // ln 2^-23

// Returns ln(1 - tanh(y^2)). If `floored` is true, the result is at least ln(2^-23), the logarithm of the
// float epsilon.
template <class S>
S log_query_factor(const S& y, bool floored = true) {
  using std::exp;
  using std::log1p;
  const S u = value(y) * value(y) < kLargestU ? y * y : S(kLargestU);
  const S factor = std::log(2.0) - 2.0 * u - log1p(exp(-2.0 * u));
  return floored && value(factor) < kLowestLogFactor ? S(kLowestLogFactor) : factor;
}

// Guards marks splats whose value or derivative is not that of the plain formula, because of the documented
// clamps.
struct Guards {
  // A pivot of the query factor was raised: the value is defined, but the derivative is not.
  bool pivot = false;
  // A value is within rounding of a kink of a formula, so the derivative may be that of either side.
  bool kink = false;
  // A value is outside the range of single precision, so a program may render the splat or cull it.
  bool out_of_range = false;
};

template <class S>
struct Conditioned {
  std::array<S, 3> mean;
  Matrix<S> covariance;  // the full V of method.md 2.3, asymmetric in general
  S opacity;             // o_q
  Guards guards;
  // Sums of the magnitudes of the terms of `covariance`. They are computed only if S is double.
  Matrix<double> covariance_terms{3, 3};
};

inline constexpr double kLargestFloat = 3.4028234663852886e38;
// A splat is not rendered if the vector of all its raw parameters is longer than this. kernels/limits.h
// explains why.
inline constexpr double kLargestRaw = 1e12;
template <class S>
bool in_raw_range(std::span<const S> raw) {
  double square = 0;
  for (const S& x : raw) square += value(x) * value(x);
  return square <= kLargestRaw * kLargestRaw;
}
// Limit for numbers whose squares or triple products must be representable in single precision.
inline constexpr double kLargestFactor = 1e18;
// If the relative distance of a value from a kink of a formula is below this, rounding decides on which side
// of the kink the value is.
inline constexpr double kKinkMargin = 1e-5;

// Returns whether a clamped parameter is within rounding of its clamp.
template <class S>
bool near_clamp(std::span<const S> raw, const Rows& rows, const Matrix<S>& factor,
                const ModelVariant& variant) {
  const auto close = [](double a, double b) { return std::abs(a - b) < kKinkMargin * std::abs(b); };
  if (variant.has_spatial_beta() && close(value(raw[rows.beta]), kLargestRawBeta)) return true;
  double largest = 0;
  for (int i = 0; i < 3; ++i) largest = std::max(largest, softplus(value(raw[rows.scale + i])));
  for (int i = 0; i < 3; ++i)
    if (close(softplus(value(raw[rows.scale + i])), least_spatial_scale(variant) * largest)) return true;
  if (variant.conditioning == Conditioning::direct) return false;
  for (int i = variant.cov_param == CovParam::skew_nd ? 0 : 3; i < rows.dim; ++i) {
    const double least = i < 3 ? kMinSkewMotion : least_query_scale(variant);
    double square = 0;
    for (int j = i < 3 ? 3 : 0; j < rows.dim; ++j)
      if (j != i) square += value(factor(i, j)) * value(factor(i, j));
    if (close(softplus(value(raw[rows.scale + i])), least * std::sqrt(square))) return true;
  }
  return false;
}

// Returns ln(o_q / o), where o is the opacity and o_q the opacity for the query. y is the whitened residual
// of the query.
template <class S>
S log_opacity_factor(std::span<const S> raw, const Rows& rows, const std::vector<S>& y,
                     const ModelVariant& variant) {
  using std::exp;
  S result(0);
  if (variant.beta_opacity == BetaOpacity::none) return result;
  for (int i = 0; i < rows.query; ++i) {
    if (variant.beta_opacity == BetaOpacity::gaussian)
      result -= 0.35 * (value(y[i]) * value(y[i]) < kLargestU ? y[i] * y[i] : S(kLargestU));
    else
      result += 4.0 * exp(raw[rows.query_beta + i]) * log_query_factor(y[i]);
  }
  return result;
}

// Returns whether an opacity factor is within rounding of its floor.
template <class S>
bool near_floor(const std::vector<S>& y, const ModelVariant& variant) {
  if (variant.beta_opacity != BetaOpacity::tanh) return false;
  return std::any_of(y.begin(), y.end(), [](const S& yi) {
    return std::abs(log_query_factor(value(yi), false) / kLowestLogFactor - 1) < kKinkMargin;
  });
}

// Computes the mean and the opacity of a splat with direct conditioning. L is the factor of the query
// precision, s Theta is the cross covariance (s is the mean spatial scale), and the diagonal matrix W
// contains the weights of the query dimensions. x is the query minus its mean. The conditional mean is the
// mean plus s Theta W (L L^T) x. The factor of the opacity is evaluated at L^T x.
template <class S>
void condition_directly(std::span<const S> raw, const Rows& rows, const std::vector<S>& x,
                        const ModelVariant& variant, Conditioned<S>& result) {
  using std::exp;
  const int c = rows.query;
  const std::array<S, 3> scales = spatial_scales(raw, rows, variant);
  const S mean_scale = (scales[0] + scales[1] + scales[2]) / S(3);
  Matrix<S> lower(c, c), cross(3, c), weights(c, c), deviation(c, 1);
  for (int i = 0; i < c; ++i) {
    const int row = rows.triangle + (i + 3) * (i + 2) / 2;
    for (int k = 0; k < 3; ++k) cross(k, i) = mean_scale * raw[row + k];
    for (int j = 0; j < i; ++j) lower(i, j) = raw[row + 3 + j];
    lower(i, i) = softplus(raw[rows.scale + 3 + i]);
    deviation(i, 0) = x[i];
    weights(i, i) = S(1);
    if (variant.beta_cond == BetaCond::off) continue;
    const S b = raw[rows.query_beta + i];
    weights(i, i) = variant.beta_opacity == BetaOpacity::tanh ? condition_weight(b) : sigmoid(b);
  }
  const Matrix<S> offset = cross * weights * (lower * lower.transposed()) * deviation;
  for (int r = 0; r < 3; ++r) result.mean[r] += offset(r, 0);
  const Matrix<S> white = lower.transposed() * deviation;
  std::vector<S> y;
  for (int i = 0; i < c; ++i) y.push_back(white(i, 0));
  result.opacity = result.opacity * exp(log_opacity_factor(raw, rows, y, variant));
  result.guards.kink = result.guards.kink || near_floor(y, variant);
  for (int i = 0; i < c * c; ++i)
    if (!(std::abs(value(lower(i / c, i % c))) < kLargestFactor)) result.guards.out_of_range = true;
  for (int i = 0; i < 3 * c; ++i)
    if (!(std::abs(value(cross(i / c, i % c))) < kLargestFactor)) result.guards.out_of_range = true;
}

// Computes the mean, the covariance and the opacity of a splat for the query of the camera.
template <class S>
Conditioned<S> condition(std::span<const S> raw, const Rows& rows, const Camera& camera,
                         const Options& options) {
  using std::exp;
  const int c = rows.query;
  const ModelVariant& variant = options.variant;
  const Matrix<S> factor = covariance_factor(raw, rows, variant);
  const Matrix<S> spatial = factor.block(0, 0, 3, rows.dim);
  Conditioned<S> result{
      {raw[0], raw[1], raw[2]}, spatial * spatial.transposed(), sigmoid(raw[rows.opacity]), {}};
  for (int i = 0; i < rows.dim * rows.dim; ++i)
    if (!(std::abs(value(factor(i / rows.dim, i % rows.dim))) < kLargestFactor))
      result.guards.out_of_range = true;
  result.guards.kink = near_clamp(raw, rows, factor, variant);
  if constexpr (std::is_same_v<S, double>)
    result.covariance_terms = absolute(spatial) * absolute(spatial).transposed();
  if (c == 0) return result;

  std::vector<S> x = query_vector(raw, rows, camera, options.query_grad);
  for (int i = 0; i < c; ++i) {
    x[i] -= raw[rows.mean + i];
    if (!(std::abs(value(x[i])) < kLargestFactor)) result.guards.out_of_range = true;
  }
  if (variant.conditioning == Conditioning::direct) {
    condition_directly<S>(raw, rows, x, variant, result);
    return result;
  }
  // F are the spatial rows of the factor and B its query rows, which are factorised as B = L Q. Then Sigma_xq
  // Sigma_q^-1 = F Q^T L^-1.
  const Matrix<S> query = factor.block(3, 0, c, rows.dim);
  const LowerOrthogonal<S> lq = lower_orthogonal(query);
  const std::vector<S> y = forward_substitution<S>(lq.lower, x);
  const S log_factor = log_opacity_factor(raw, rows, y, variant);
  Matrix<S> weights(c, c), column(c, 1);
  for (int j = 0; j < c; ++j)
    weights(j, j) = variant.beta_cond == BetaCond::on ? condition_weight(raw[rows.query_beta + j]) : S(1);
  const bool whitened = variant.cov_mode == CovMode::whiten;
  for (int j = 0; j < c; ++j) column(j, 0) = whitened ? y[j] : x[j];
  // The offset of the mean is F Q^T z with z = solve * column. The conditional covariance is V = F (I - Q^T
  // Y) F^T, where Y is solve * Q if whitened and solve * B otherwise.
  const Matrix<S> solve = whitened ? weights : inverse(lq.lower) * weights;
  const Matrix<S> offset = spatial * lq.rows.transposed() * (solve * column);
  const Matrix<S> kept =
      Matrix<S>::identity(rows.dim) - lq.rows.transposed() * (solve * (whitened ? lq.rows : query));
  for (int r = 0; r < 3; ++r) result.mean[r] += offset(r, 0);
  result.covariance = spatial * kept * spatial.transposed();
  result.opacity = result.opacity * exp(log_factor);
  if constexpr (std::is_same_v<S, double>) {
    const Matrix<double> terms =
        Matrix<double>::identity(rows.dim) +
        absolute(lq.rows.transposed()) * absolute(solve * (whitened ? lq.rows : query));
    result.covariance_terms = absolute(spatial) * terms * absolute(spatial).transposed();
  }
  result.guards.pivot = lq.floored;
  result.guards.kink = result.guards.kink || near_floor(y, variant);
  return result;
}

// Footprint contains the values of a splat that are needed to composite it in a pixel.
template <class S>
struct Footprint {
  std::array<S, 2> mean;
  std::array<S, 3> conic;  // Q00, Q01, Q11
  S opacity, beta;
  std::array<S, 3> rgb;
  S depth = S(0);
  // Entries 00, 01 and 11 of the 2 x 2 matrix of the ellipse of the support in the image. Entries 00 and 11
  // include eps2d.
  std::array<S, 3> cov;
  bool visible = false;
  // The splat is between the near and far planes. If it is not, only `depth`, `reach` and `guards` are set.
  bool in_range = false;
  double reach = 0;  // sum |mean_j - centre_j|, the magnitude of the terms of the camera-space mean
  Guards guards;
  // Product of the two diagonal entries of `cov`, each computed from the magnitudes of its terms, divided by
  // the magnitude of the determinant of `cov`. This is the factor by which rounding may be amplified in the
  // conic. It is computed only if S is double.
  double amplification = 1;
};

template <class S>
S clamp_by_value(const S& x, double low, double high) {
  return value(x) < low ? S(low) : value(x) > high ? S(high) : x;
}

// Returns the affine approximation J of the pinhole projection at the camera-space point p. In J, the slopes
// x/z and y/z are clamped to the field of view, which is extended on each side by 0.3 times half of its width
// or height.
template <class S>
Matrix<S> projection_jacobian(const std::array<S, 3>& p, const Camera& camera) {
  const double margin_x = 0.3 * camera.width / (2 * camera.fx);
  const double margin_y = 0.3 * camera.height / (2 * camera.fy);
  const S tx = p[2] * clamp_by_value<S>(p[0] / p[2], -(camera.cx / camera.fx + margin_x),
                                        (camera.width - camera.cx) / camera.fx + margin_x);
  const S ty = p[2] * clamp_by_value<S>(p[1] / p[2], -(camera.cy / camera.fy + margin_y),
                                        (camera.height - camera.cy) / camera.fy + margin_y);
  Matrix<S> j(2, 3);
  j(0, 0) = camera.fx / p[2], j(0, 2) = -(camera.fx * tx / (p[2] * p[2]));
  j(1, 1) = camera.fy / p[2], j(1, 2) = -(camera.fy * ty / (p[2] * p[2]));
  return j;
}

// Returns the symmetric matrix that has the upper triangle of V. The lower triangle of V may differ and is
// not used.
template <class S>
Matrix<S> symmetric(const Matrix<S>& v) {
  Matrix<S> result = v;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < i; ++j) result(i, j) = result(j, i);
  return result;
}

// Returns a tenth of the amount that the blur (eps2d) adds to the determinant of an ellipse. A splat whose
// determinant is not above this is not rendered.
template <class S>
double least_determinant(const std::array<S, 3>& cov, double eps2d) {
  return 0.1 * eps2d * (value(cov[0]) + value(cov[2]) - eps2d);
}

template <class S>
bool all_finite(const Footprint<S>& f) {
  for (const S& x : {f.mean[0], f.mean[1], f.conic[0], f.conic[1], f.conic[2], f.opacity, f.beta, f.rgb[0],
                     f.rgb[1], f.rgb[2], f.depth})
    if (!std::isfinite(value(x))) return false;
  return true;
}

// Returns whether values of the footprint, or the terms that they are computed from, may exceed the range of
// single precision.
template <class S>
bool beyond_float(const Footprint<S>& f, double product) {
  constexpr double kMost = kLargestFloat / 16;
  const double light = std::abs(value(f.rgb[0])) + std::abs(value(f.rgb[1])) + std::abs(value(f.rgb[2]));
  for (double x : {value(f.mean[0]), value(f.mean[1]), value(f.beta), value(f.depth), product, light})
    if (!(std::abs(x) < kMost)) return true;
  return false;
}

// The spherical Beta lobes of Deformable Beta Splatting use two functions. lobe_cosine() returns the cosine
// of the angle between the direction d and the axis of a lobe, which has the spherical coordinates theta and
// phi. sharp_softplus() is a softplus with the sharpness 10 ln 2.
template <class S>
S lobe_cosine(const S& theta, const S& phi, const std::array<S, 3>& d) {
  using std::cos, std::sin;
  return sin(theta) * (cos(phi) * d[0] + sin(phi) * d[1]) + cos(theta) * d[2];
}

template <class S>
S sharp_softplus(const S& x) {
  using std::exp, std::log1p;
  const double k = 10 * std::numbers::ln2;
  return value(x) > 0 ? x + log1p(exp(-k * x)) / k : log1p(exp(k * x)) / k;
}

template <class S>
std::array<S, 3> colour(std::span<const S> raw, const Rows& rows, const Camera& camera, bool query_grad) {
  using std::exp;
  if (rows.harmonics == 0) return {raw[rows.rgb], raw[rows.rgb + 1], raw[rows.rgb + 2]};
  std::array<S, 3> direction = view_direction<S>({raw[0], raw[1], raw[2]}, camera);
  if (!query_grad)
    for (S& d : direction) d = S(value(d));
  const std::vector<S> basis = spherical_harmonics(direction, rows.harmonics);
  std::array<S, 3> result;
  for (int c = 0; c < 3; ++c) {
    S sum(0.5);
    for (int k = 0; k < rows.harmonics; ++k)
      sum += basis[k] * raw[k == 0 ? rows.rgb + c : rows.rgb + 3 + c * (rows.harmonics - 1) + k - 1];
    result[c] = value(sum) > 0 ? sum : S(0);
  }
  for (int lobe = 0; lobe < rows.lobes; ++lobe) {
    const auto field = [&](int f) { return raw[rows.rgb + 3 + f * rows.lobes + lobe]; };
    const S cosine = lobe_cosine(field(3), field(4), direction);
    if (!(value(cosine) > 0)) continue;
    const S raw_beta = value(field(5)) < kLargestRawBeta ? field(5) : S(kLargestRawBeta);
    const S height = rim_power(1.0 - cosine, 4.0 * exp(raw_beta));
    for (int c = 0; c < 3; ++c) result[c] += height * sharp_softplus(field(c));
  }
  return result;
}

// Returns whether the slope x/z or y/z of a point is within rounding of its limits in projection_jacobian().
inline bool near_limit(double slope, double low, double high) {
  const double margin = kKinkMargin * std::max(std::abs(low), std::abs(high));
  return std::abs(slope - low) < margin || std::abs(slope - high) < margin;
}

inline bool near_frustum_limit(const std::array<double, 3>& p, const Camera& camera) {
  const double margin_x = 0.3 * camera.width / (2 * camera.fx);
  const double margin_y = 0.3 * camera.height / (2 * camera.fy);
  return near_limit(p[0] / p[2], -(camera.cx / camera.fx + margin_x),
                    (camera.width - camera.cx) / camera.fx + margin_x) ||
         near_limit(p[1] / p[2], -(camera.cy / camera.fy + margin_y),
                    (camera.height - camera.cy) / camera.fy + margin_y);
}

// Returns the footprint of a splat. If `shift` is given, it is added to the mean in the camera's frame.
// study.cpp uses it to compute the effect of rounding errors of the position.
template <class S>
Footprint<S> footprint(std::span<const S> raw, const Rows& rows, const Camera& camera, const Options& options,
                       const std::array<S, 3>* shift = nullptr) {
  using std::exp;
  using std::sqrt;
  if (!in_raw_range(raw)) return {};
  const Conditioned<S> conditioned = condition(raw, rows, camera, options);
  Matrix<S> world_to_camera(3, 3);
  for (int i = 0; i < 9; ++i) world_to_camera(i / 3, i % 3) = S(camera.rotation[i]);
  const std::array<double, 3> centre = camera_centre(camera);
  Footprint<S> result;
  std::array<S, 3> p{camera.translation[0], camera.translation[1], camera.translation[2]};
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 3; ++k) p[i] += world_to_camera(i, k) * conditioned.mean[k];
    if (shift) p[i] += (*shift)[i];
    result.reach += std::abs(value(conditioned.mean[i]) - centre[i]);
  }

  result.guards = conditioned.guards;
  result.depth = p[2];
  if (!(value(p[2]) >= options.near_plane && value(p[2]) <= options.far_plane)) return result;
  result.in_range = true;
  const Matrix<S> jw = projection_jacobian(p, camera) * world_to_camera;
  Matrix<S> b = jw * symmetric(conditioned.covariance) * jw.transposed();
  const S sharp_det = b(0, 0) * b(1, 1) - b(0, 1) * b(0, 1);
  b(0, 0) += S(options.eps2d), b(1, 1) += S(options.eps2d);
  const S det = b(0, 0) * b(1, 1) - b(0, 1) * b(0, 1);

  if constexpr (std::is_same_v<S, double>) {
    const Matrix<double> terms = absolute(jw) * conditioned.covariance_terms * absolute(jw).transposed();
    result.amplification = (terms(0, 0) + options.eps2d) * (terms(1, 1) + options.eps2d) / std::abs(det);
  }
  result.mean = {camera.fx * p[0] / p[2] + camera.cx, camera.fy * p[1] / p[2] + camera.cy};
  result.cov = {b(0, 0), b(0, 1), b(1, 1)};
  result.conic = {b(1, 1) / det, -b(0, 1) / det, b(0, 0) / det};
  result.opacity = conditioned.opacity;
  if (options.variant.antialias == Antialias::on)
    result.opacity = value(sharp_det) > 0 ? result.opacity * sqrt(sharp_det / det) : S(0);
  result.beta = options.variant.has_spatial_beta()
                    ? 4.0 * exp(value(raw[rows.beta]) < kLargestRawBeta ? raw[rows.beta] : S(kLargestRawBeta))
                    : S(0);
  result.rgb = colour(raw, rows, camera, options.query_grad);
  result.visible = value(det) > std::max(0.0, least_determinant(result.cov, options.eps2d)) &&
                   value(b(0, 0)) > 0 && value(b(1, 1)) > 0 && all_finite(result);
  result.guards.kink =
      result.guards.kink || near_frustum_limit({value(p[0]), value(p[1]), value(p[2])}, camera);
  result.guards.out_of_range =
      result.guards.out_of_range || beyond_float(result, value(b(0, 0)) * value(b(1, 1)));
  return result;
}

// Returns r = D^T Q D, but at least 0, because rounding at the centre of a stretched splat may give a small
// negative number.
template <class S>
S kernel_radius(const Footprint<S>& f, double pixel_x, double pixel_y) {
  const S dx = f.mean[0] - pixel_x, dy = f.mean[1] - pixel_y;
  const S r = f.conic[0] * dx * dx + 2.0 * f.conic[1] * dx * dy + f.conic[2] * dy * dy;
  return value(r) < 0 ? S(0) : r;
}

inline constexpr double kMaxAlpha = 0.999, kMaxAlphaGaussian = 0.99, kMinAlphaGaussian = 1.0 / 255;
inline constexpr double kMinTransmittance = 1e-4;

// The next three functions are all that the oracle knows of the spatial kernels. They have one case per
// kernel.

struct KernelLimits {
  double most;   // alpha is reduced to this value
  double least;  // contributions with a smaller alpha are skipped
  double
      support;  // r at the edge of the support; for a Gaussian, r where an opaque splat has the alpha `least`
};
inline KernelLimits limits_of(SpatialKernel kernel) {
  switch (kernel) {
    case SpatialKernel::beta:
      return {kMaxAlpha, 0, 1};
    case SpatialKernel::gaussian:
      return {kMaxAlphaGaussian, kMinAlphaGaussian, -2 * std::log(kMinAlphaGaussian)};
  }
  throw std::invalid_argument("oracle: unknown spatial kernel");
}

// Returns the value of the kernel inside of its support.
template <class S>
S kernel_value(SpatialKernel kernel, const S& r, const S& beta) {
  using std::exp;
  switch (kernel) {
    case SpatialKernel::beta:
      return rim_power(r, beta);
    case SpatialKernel::gaussian:
      return exp(-0.5 * r);
  }
  throw std::invalid_argument("oracle: unknown spatial kernel");
}

// Returns -d(ln F)/dr of the kernel F.
inline double kernel_slope(SpatialKernel kernel, double r, double beta) {
  switch (kernel) {
    case SpatialKernel::beta:
      return beta / std::max(1 - r, 1e-300);
    case SpatialKernel::gaussian:
      return 0.5;
  }
  throw std::invalid_argument("oracle: unknown spatial kernel");
}

template <class S>
S splat_alpha(const Footprint<S>& f, const S& r, SpatialKernel kernel = SpatialKernel::beta) {
  const double most = limits_of(kernel).most;
  const S alpha = f.opacity * kernel_value(kernel, r, f.beta);
  return value(alpha) > most ? S(most) : alpha;
}

// Returns whether the splat contributes at a point.
inline bool reaches(const Footprint<double>& f, double r, SpatialKernel kernel) {
  const KernelLimits limits = limits_of(kernel);
  return limits.least > 0 ? splat_alpha(f, r, kernel) >= limits.least : r < limits.support;
}

}  // namespace ubs::oracle
