// SPDX-License-Identifier: Apache-2.0
// The per-splat formulas of the oracle: raw parameters of one splat -> its footprint in one image.
// Written plainly from the method (dense matrices, full NxN covariance, Gauss-Jordan inverse beside a
// separate Cholesky) as templates over the scalar of tape.hpp. Nothing here is shared with the production
// code. Every scalar branch takes value(x): clamps and culls follow the value and carry no gradient of their
// own.
#pragma once

#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <stdexcept>
#include <vector>

#include "host/scene/camera.hpp"
#include "tests/reference/oracle.hpp"
#include "tests/reference/tape.hpp"

namespace ubs::oracle {

// Row numbers in file order, derived here again so that the layout of the product is checked, not trusted.
struct Rows {
  explicit Rows(int n)
      : dim(n),
        query(n - 3),
        beta(7),
        mean(beta + 1 + query),
        scale(mean + query),
        triangle(scale + n),
        count(triangle + n * (n - 1) / 2) {
    if (n < 3) throw std::invalid_argument("oracle: a splat has at least 3 dimensions");
  }
  int dim, query;
  int xyz = 0, rgb = 3, opacity = 6, beta, mean, scale, triangle, count;
};

template <class S>
class Matrix {
 public:
  Matrix(int rows, int columns) : rows_(rows), columns_(columns), data_(rows * columns, S(0)) {}
  static Matrix identity(int n) {
    Matrix result(n, n);
    for (int i = 0; i < n; ++i) result(i, i) = S(1);
    return result;
  }
  S& operator()(int i, int j) { return data_[i * columns_ + j]; }
  const S& operator()(int i, int j) const { return data_[i * columns_ + j]; }
  int rows() const { return rows_; }
  int columns() const { return columns_; }
  Matrix transposed() const {
    Matrix result(columns_, rows_);
    for (int i = 0; i < rows_; ++i)
      for (int j = 0; j < columns_; ++j) result(j, i) = (*this)(i, j);
    return result;
  }
  Matrix block(int row, int column, int rows, int columns) const {
    Matrix result(rows, columns);
    for (int i = 0; i < rows; ++i)
      for (int j = 0; j < columns; ++j) result(i, j) = (*this)(row + i, column + j);
    return result;
  }
  friend Matrix operator*(const Matrix& a, const Matrix& b) {
    Matrix result(a.rows_, b.columns_);
    for (int i = 0; i < a.rows_; ++i)
      for (int j = 0; j < b.columns_; ++j)
        for (int k = 0; k < a.columns_; ++k) result(i, j) += a(i, k) * b(k, j);
    return result;
  }
  friend Matrix operator-(const Matrix& a, const Matrix& b) {
    Matrix result(a.rows_, a.columns_);
    for (int i = 0; i < a.rows_ * a.columns_; ++i) result.data_[i] = a.data_[i] - b.data_[i];
    return result;
  }

 private:
  int rows_, columns_;
  std::vector<S> data_;
};

template <class S>
S softplus(const S& x) {
  using std::exp;
  using std::log1p;
  return value(x) > 20 ? x : log1p(exp(x));
}

// R = I + A, official packing: a0, a1, a2 with plus in the upper triangle.
template <class S>
Matrix<S> rotation(std::span<const S> raw, const Rows& rows) {
  const S &a0 = raw[rows.triangle], &a1 = raw[rows.triangle + 1], &a2 = raw[rows.triangle + 2];
  Matrix<S> result = Matrix<S>::identity(3);
  result(0, 1) = a0, result(0, 2) = a1, result(1, 2) = a2;
  result(1, 0) = -a0, result(2, 0) = -a1, result(2, 1) = -a2;
  return result;
}

// The N x N factor L = [[R diag(s_x), 0], [Lqx, Lq]] of the covariance L L^T.
template <class S>
Matrix<S> covariance_factor(std::span<const S> raw, const Rows& rows) {
  const int n = rows.dim;
  Matrix<S> result(n, n);
  const Matrix<S> r = rotation(raw, rows);
  for (int j = 0; j < 3; ++j) {
    const S scale = softplus(raw[rows.scale + j]);
    for (int i = 0; i < 3; ++i) result(i, j) = r(i, j) * scale;
  }
  for (int i = 3; i < n; ++i) {
    for (int j = 0; j < i; ++j) result(i, j) = raw[rows.triangle + i * (i - 1) / 2 + j];
    result(i, i) = softplus(raw[rows.scale + i]);
  }
  return result;
}

// Gauss-Jordan without pivoting: sufficient for a symmetric positive definite matrix.
template <class S>
Matrix<S> inverse(Matrix<S> a) {
  const int n = a.rows();
  Matrix<S> result = Matrix<S>::identity(n);
  for (int k = 0; k < n; ++k) {
    const S pivot = a(k, k);
    for (int j = 0; j < n; ++j) {
      a(k, j) = a(k, j) / pivot;
      result(k, j) = result(k, j) / pivot;
    }
    for (int i = 0; i < n; ++i) {
      if (i == k) continue;
      const S factor = a(i, k);
      for (int j = 0; j < n; ++j) {
        a(i, j) -= factor * a(k, j);
        result(i, j) -= factor * result(k, j);
      }
    }
  }
  return result;
}

// Lower factor with positive diagonal. A non-positive pivot becomes NaN and the splat is culled.
template <class S>
Matrix<S> cholesky(const Matrix<S>& a) {
  using std::sqrt;
  Matrix<S> result(a.rows(), a.rows());
  for (int j = 0; j < a.rows(); ++j)
    for (int i = j; i < a.rows(); ++i) {
      S sum = a(i, j);
      for (int k = 0; k < j; ++k) sum -= result(i, k) * result(j, k);
      result(i, j) = i == j ? sqrt(sum) : sum / result(j, j);
    }
  return result;
}

template <class S>
std::vector<S> forward_substitution(const Matrix<S>& lower, std::span<const S> right) {
  std::vector<S> result;
  for (int i = 0; i < lower.rows(); ++i) {
    S sum = right[i];
    for (int k = 0; k < i; ++k) sum -= lower(i, k) * result[k];
    result.push_back(sum / lower(i, i));
  }
  return result;
}

inline std::array<double, 3> camera_centre(const Camera& camera) {
  std::array<double, 3> centre{};
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k) centre[i] -= camera.rotation[3 * k + i] * camera.translation[k];
  return centre;
}

// Direction from the camera to the unconditional mean; the scalar type decides about its gradient.
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

// C = 1, 2: (t, extra...); C >= 3: the direction first, then (t, extra...).
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

// min(exp b, 1) with the slope of exp for b < 0 and exactly none from b = 0 upwards.
template <class S>
S condition_weight(const S& b) {
  using std::exp;
  return value(b) < 0 ? exp(b) : S(1);
}

// ln(1 - tanh(y^2)), floored at the logarithm of the float epsilon.
template <class S>
S log_query_factor(const S& y) {
  using std::exp;
  using std::log1p;
  static const double kFloor = -23 * std::log(2.0);
  const S u = y * y;
  const S factor = std::log(2.0) - 2.0 * u - log1p(exp(-2.0 * u));
  return value(factor) < kFloor ? S(kFloor) : factor;
}

template <class S>
struct Conditioned {
  std::array<S, 3> mean;
  Matrix<S> covariance;  // the full V of method 2.3, asymmetric in general
  S opacity;             // o_q
};

template <class S>
Conditioned<S> condition(std::span<const S> raw, const Rows& rows, const Camera& camera, bool query_grad) {
  using std::exp;
  const int c = rows.query;
  const Matrix<S> factor = covariance_factor(raw, rows);
  const Matrix<S> sigma = factor * factor.transposed();
  Conditioned<S> result{{raw[0], raw[1], raw[2]}, sigma.block(0, 0, 3, 3), sigmoid(raw[rows.opacity])};
  if (c == 0) return result;

  std::vector<S> x = query_vector(raw, rows, camera, query_grad);
  for (int i = 0; i < c; ++i) x[i] -= raw[rows.mean + i];
  const Matrix<S> sigma_xq = sigma.block(0, 3, 3, c), sigma_q = sigma.block(3, 3, c, c);
  Matrix<S> gain = sigma_xq * inverse(sigma_q);
  for (int j = 0; j < c; ++j) {
    const S weight = condition_weight(raw[rows.beta + 1 + j]);
    for (int r = 0; r < 3; ++r) {
      gain(r, j) = gain(r, j) * weight;
      result.mean[r] += gain(r, j) * x[j];
    }
  }
  result.covariance = result.covariance - gain * sigma_xq.transposed();

  const std::vector<S> y = forward_substitution<S>(cholesky(sigma_q), x);
  S log_factor(0);
  for (int i = 0; i < c; ++i) log_factor += 4.0 * exp(raw[rows.beta + 1 + i]) * log_query_factor(y[i]);
  result.opacity = result.opacity * exp(log_factor);
  return result;
}

// What a pixel needs to know about a splat.
template <class S>
struct Footprint {
  std::array<S, 2> mean;
  std::array<S, 3> conic;  // Q00, Q01, Q11
  S opacity, beta;
  std::array<S, 3> rgb;
  S depth;
  bool visible = false;
};

template <class S>
S clamp_by_value(const S& x, double low, double high) {
  return value(x) < low ? S(low) : value(x) > high ? S(high) : x;
}

// The affine approximation J of the pinhole projection at the camera-space point p, columns limited to
// 1.3 times the half field of view around the true principal point.
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

// Upper triangle of V, mirrored: the lower entries of the general V are not used at all.
template <class S>
Matrix<S> mirrored_upper(const Matrix<S>& v) {
  Matrix<S> result = v;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < i; ++j) result(i, j) = v(j, i);
  return result;
}

template <class S>
bool all_finite(const Footprint<S>& f) {
  for (const S& x : {f.mean[0], f.mean[1], f.conic[0], f.conic[1], f.conic[2], f.opacity, f.beta, f.rgb[0],
                     f.rgb[1], f.rgb[2], f.depth})
    if (!std::isfinite(value(x))) return false;
  return true;
}

template <class S>
Footprint<S> footprint(std::span<const S> raw, const Rows& rows, const Camera& camera,
                       const Options& options) {
  using std::exp;
  const Conditioned<S> conditioned = condition(raw, rows, camera, options.query_grad);
  Matrix<S> world_to_camera(3, 3);
  for (int i = 0; i < 9; ++i) world_to_camera(i / 3, i % 3) = S(camera.rotation[i]);
  std::array<S, 3> p{camera.translation[0], camera.translation[1], camera.translation[2]};
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k) p[i] += world_to_camera(i, k) * conditioned.mean[k];

  Footprint<S> result;
  result.depth = p[2];
  if (!(value(p[2]) >= options.near_plane && value(p[2]) <= options.far_plane)) return result;
  const Matrix<S> jw = projection_jacobian(p, camera) * world_to_camera;
  Matrix<S> b = jw * mirrored_upper(conditioned.covariance) * jw.transposed();
  b(0, 0) += S(options.eps2d), b(1, 1) += S(options.eps2d);
  const S det = b(0, 0) * b(1, 1) - b(0, 1) * b(0, 1);
  if (!(value(det) > 0 && value(b(0, 0)) > 0 && value(b(1, 1)) > 0)) return result;

  result.mean = {camera.fx * p[0] / p[2] + camera.cx, camera.fy * p[1] / p[2] + camera.cy};
  result.conic = {b(1, 1) / det, -b(0, 1) / det, b(0, 0) / det};
  result.opacity = conditioned.opacity;
  result.beta = 4.0 * exp(raw[rows.beta]);
  result.rgb = {raw[rows.rgb], raw[rows.rgb + 1], raw[rows.rgb + 2]};
  result.visible = all_finite(result);
  return result;
}

// r = D^T Q D, not below 0: rounding at the centre of a stretched splat may give a tiny negative number.
template <class S>
S kernel_radius(const Footprint<S>& f, double pixel_x, double pixel_y) {
  const S dx = f.mean[0] - pixel_x, dy = f.mean[1] - pixel_y;
  const S r = f.conic[0] * dx * dx + 2.0 * f.conic[1] * dx * dy + f.conic[2] * dy * dy;
  return value(r) < 0 ? S(0) : r;
}

inline constexpr double kMaxAlpha = 0.999;
inline constexpr double kMinTransmittance = 1e-4;

template <class S>
S splat_alpha(const Footprint<S>& f, const S& r) {
  const S alpha = f.opacity * rim_power(r, f.beta);
  return value(alpha) > kMaxAlpha ? S(kMaxAlpha) : alpha;
}

}  // namespace ubs::oracle
