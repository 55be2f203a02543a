// SPDX-License-Identifier: Apache-2.0
// See slice.hpp.
#include "host/scene/slice.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "host/scene/spatial_factor.hpp"
#include "kernels/dialect/dialect.h"
#include "kernels/limits.h"

namespace ubs {

bool Slicer::knows(const ModelVariant& variant) {
  ModelVariant published = variant;
  published.rot_mode = {};
  published.cov_param = {};
  published.beta_cond = {};
  published.beta_opacity = {};
  published.cov_mode = {};
  published.tanh_floor = {};
  return published == variant;
}

Slicer::Slicer(const SplatModel& model, std::size_t splat)
    : c_(static_cast<std::size_t>(model.layout().query)) {
  const ParameterLayout l = model.layout();
  const auto at = [&](int row, std::size_t k) {
    return static_cast<double>(model.row(row + static_cast<int>(k))[splat]);
  };
  const auto lower = [&](std::size_t r, std::size_t k) { return at(l.l_triangle, r * (r - 1) / 2 + k); };
  opacity_ = 1 / (1 + std::exp(-at(l.opacity, 0)));
  if (l.variant.has_spatial_beta()) beta_ = 4 * std::exp(std::min(at(l.beta, 0), UBS_BETA_RAW_MAX));
  double m[3][3] = {
      {1, lower(1, 0), lower(2, 0)}, {-lower(1, 0), 1, lower(2, 1)}, {-lower(2, 0), -lower(2, 1), 1}};
  double largest = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    mean_[k] = at(l.xyz, k);
    largest = std::max(largest, softplus_of(at(l.scale, k)));
  }
  for (std::size_t k = 0; k < 3; ++k)
    for (auto& row : m) row[k] *= std::max(softplus_of(at(l.scale, k)), UBS_NEEDLE_RELATIVE * largest);
  for (std::size_t a = 0; a < 3; ++a)
    for (std::size_t b = 0; b < 3; ++b)
      for (std::size_t k = 0; k < 3; ++k) sigma_x_[a][b] += m[a][k] * m[b][k];
  double rows[kMaxQuery][3 + kMaxQuery] = {};  // (Lqx, Lq)
  for (std::size_t q = 0; q < c_; ++q) {
    mean_q_[q] = at(l.mean, q);
    beta_q_[q] = 4 * std::exp(at(l.query_beta, q));
    weight_[q] = std::min(beta_q_[q] / 4, 1.0);
    double square = 0;
    for (std::size_t k = 0; k < 3 + q; ++k) {
      rows[q][k] = lower(3 + q, k);
      square += rows[q][k] * rows[q][k];
    }
    rows[q][3 + q] = std::max(softplus_of(at(l.scale, 3 + q)), UBS_QUERY_SCALE_RELATIVE * std::sqrt(square));
    for (std::size_t a = 0; a < 3; ++a)
      for (std::size_t k = 0; k < 3; ++k) x_[a][q] += m[a][k] * rows[q][k];
  }
  factorise(rows);
}

// Cholesky factor of Sigma_q with the pivots floored relative to their diagonal (method.md 3.5).
void Slicer::factorise(const double (&rows)[kMaxQuery][3 + kMaxQuery]) {
  for (std::size_t a = 0; a < c_; ++a)
    for (std::size_t b = 0; b <= a; ++b) {
      double sum = 0, diagonal = 0;
      for (std::size_t k = 0; k < 3 + c_; ++k) sum += rows[a][k] * rows[b][k];
      diagonal = sum;
      for (std::size_t k = 0; k < b; ++k) sum -= chol_[a][k] * chol_[b][k];
      chol_[a][b] = a == b ? std::sqrt(std::max(sum, 1e-12 * std::max(diagonal, 1e-30))) : sum / chol_[b][b];
    }
}

QueryValues Slicer::forward(QueryValues v) const {
  for (std::size_t a = 0; a < c_; ++a) {
    for (std::size_t k = 0; k < a; ++k) v[a] -= chol_[a][k] * v[k];
    v[a] /= chol_[a][a];
  }
  return v;
}

QueryValues Slicer::solve(const QueryValues& v) const {
  QueryValues y = forward(v);
  for (std::size_t a = c_; a-- > 0;) {
    for (std::size_t k = a + 1; k < c_; ++k) y[a] -= chol_[k][a] * y[k];
    y[a] /= chol_[a][a];
  }
  return y;
}

Slice Slicer::at(const QueryValues& query) const {
  Slice s;
  QueryValues d{};
  for (std::size_t k = 0; k < c_; ++k) d[k] = query[k] - mean_q_[k];
  const QueryValues y = forward(d);
  double exponent = 0;
  for (std::size_t k = 0; k < c_; ++k)
    exponent += beta_q_[k] * std::max(std::numbers::ln2 - softplus_of(2 * y[k] * y[k]), -15.942385);
  s.opacity = opacity_ * std::exp(exponent);
  s.mean = mean_;
  for (std::size_t a = 0; a < 3; ++a) {
    QueryValues row{};
    std::copy_n(x_[a], c_, row.begin());
    QueryValues g = solve(row);  // row a of X P, then its columns are weighted
    for (std::size_t k = 0; k < c_; ++k) {
      g[k] *= weight_[k];
      s.mean[a] += g[k] * d[k];
    }
    for (std::size_t b = a; b < 3; ++b) {
      double v = sigma_x_[a][b];
      for (std::size_t k = 0; k < c_; ++k) v -= g[k] * x_[b][k];
      s.covariance[a][b] = s.covariance[b][a] = v;
    }
  }
  return s;
}

}  // namespace ubs
