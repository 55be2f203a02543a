// SPDX-License-Identifier: Apache-2.0
#include "host/scene/conditioning.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/philox.hpp"
#include "host/scene/slice.hpp"
#include "host/scene/spatial_factor.hpp"
#include "kernels/dialect/dialect.h"
#include "kernels/limits.h"

namespace ubs {
namespace {

// Minimum of a conditioning weight. Smaller weights have no visible effect, and a division by them would
// exceed the range of float32.
constexpr double kLeastWeight = 1e-8;
constexpr int kOpacityQueries = 32;

// Block is a matrix with at most kMaxDim rows and columns.
struct Block {
  Block(int rows_, int columns_) : rows(rows_), columns(columns_) {}
  int rows, columns;
  double e[kMaxDim][kMaxDim] = {};

  Block transposed() const {
    Block out(columns, rows);
    for (int i = 0; i < rows; ++i)
      for (int j = 0; j < columns; ++j) out.e[j][i] = e[i][j];
    return out;
  }
  friend Block operator*(const Block& a, const Block& b) {
    Block out(a.rows, b.columns);
    for (int i = 0; i < a.rows; ++i)
      for (int j = 0; j < b.columns; ++j)
        for (int k = 0; k < a.columns; ++k) out.e[i][j] += a.e[i][k] * b.e[k][j];
    return out;
  }
  friend Block plus(const Block& a, double factor, const Block& b) {
    Block out = a;
    for (int i = 0; i < a.rows; ++i)
      for (int j = 0; j < a.columns; ++j) out.e[i][j] += factor * b.e[i][j];
    return out;
  }
};

// Returns the lower Cholesky factor of a symmetric matrix. Diagonal entries of the factor below `least` are
// raised to `least`. If this happens, `raised` is set.
Block lower_factor(const Block& a, double least, bool& raised) {
  Block l(a.rows, a.rows);
  for (int j = 0; j < a.rows; ++j)
    for (int i = j; i < a.rows; ++i) {
      double sum = a.e[i][j];
      for (int k = 0; k < j; ++k) sum -= l.e[i][k] * l.e[j][k];
      if (i == j) {
        raised = raised || !(sum >= least * least);
        l.e[i][i] = sum >= least * least ? std::sqrt(sum) : least;
      } else {
        l.e[i][j] = sum / l.e[j][j];
      }
    }
  return l;
}

Block lower_inverse(const Block& l) {
  Block out(l.rows, l.rows);
  for (int c = 0; c < l.rows; ++c)
    for (int i = c; i < l.rows; ++i) {
      double sum = i == c ? 1 : 0;
      for (int k = c; k < i; ++k) sum -= l.e[i][k] * out.e[k][c];
      out.e[i][c] = sum / l.e[i][i];
    }
  return out;
}

Block diagonal(const std::vector<double>& d, double power) {
  Block out(static_cast<int>(d.size()), static_cast<int>(d.size()));
  for (int i = 0; i < out.rows; ++i) out.e[i][i] = std::pow(d[static_cast<std::size_t>(i)], power);
  return out;
}

Block mirrored_upper(Block a) {
  for (int i = 0; i < a.rows; ++i)
    for (int j = 0; j < i; ++j) a.e[i][j] = a.e[j][i];
  return a;
}

// RawSplat provides access to the raw parameters of one splat.
struct RawSplat {
  RawSplat(const SplatModel& from, std::size_t splat) : model(from), l(from.layout()), i(splat) {}
  double at(int row) const { return model.row(row)[i]; }
  double triangle(int row, int column) const { return at(l.l_triangle + row * (row - 1) / 2 + column); }
  const SplatModel& model;
  const ParameterLayout l;
  std::size_t i;
};

// Returns one conditioning weight per query dimension. A weight is sigmoid(b) if the variant learns its
// weights, min(exp(b), 1) if it has other weights, and 1 if it has none. b is the raw parameter.
std::vector<double> weights_of(const RawSplat& s) {
  std::vector<double> w(static_cast<std::size_t>(s.l.query), 1.0);
  for (int q = 0; q < s.l.query && s.l.variant.beta_cond == BetaCond::on; ++q) {
    const double b = s.at(s.l.query_beta + q);
    const double weight = s.l.variant.learnt_weights() ? sigmoid(b) : std::min(std::exp(b), 1.0);
    w[static_cast<std::size_t>(q)] = std::max(weight, kLeastWeight);
  }
  return w;
}

struct Spatial {
  Block factor{3, 3};
  double mean_scale = 0;
};

Spatial spatial_of(const RawSplat& s) {
  const auto [m, scale] = spatial_factor(s.model, s.i);
  Spatial out;
  for (std::size_t r = 0; r < 3; ++r) std::copy_n(m[r].begin(), 3, out.factor.e[r]);
  out.mean_scale = (scale[0] + scale[1] + scale[2]) / 3;
  return out;
}

// Returns the query rows [Lqx, Lq] of the covariance factor of a splat with covariance conditioning.
Block query_rows(const RawSplat& s) {
  const double ratio =
      s.l.variant.cov_mode == CovMode::whiten ? UBS_QUERY_SCALE_WHITEN : UBS_QUERY_SCALE_RELATIVE;
  Block out(s.l.query, s.l.dim);
  for (int q = 0; q < s.l.query; ++q) {
    double square = 0;
    for (int j = 0; j < q + 3; ++j) {
      out.e[q][j] = s.triangle(q + 3, j);
      square += out.e[q][j] * out.e[q][j];
    }
    out.e[q][q + 3] = std::max(softplus_of(s.at(s.l.scale + 3 + q)), ratio * std::sqrt(square));
  }
  return out;
}

// Returns the lower Cholesky factor of the query precision matrix of a splat with direct conditioning.
Block precision_factor(const RawSplat& s) {
  Block out(s.l.query, s.l.query);
  for (int i = 0; i < s.l.query; ++i) {
    for (int j = 0; j < i; ++j) out.e[i][j] = s.triangle(i + 3, 3 + j);
    out.e[i][i] = softplus_of(s.at(s.l.scale + 3 + i));
  }
  return out;
}

double mean_diagonal(const Block& factor) { return (factor.e[0][0] + factor.e[1][1] + factor.e[2][2]) / 3; }

double least_axis(const Block& covariance) {
  return UBS_NEEDLE_CHOLESKY *
         std::sqrt(std::max({covariance.e[0][0], covariance.e[1][1], covariance.e[2][2], 1e-30}));
}

// Returns the mean change of the opacity factor when the residuals are computed with L^T instead of Lh^-1. Lh
// is the Cholesky factor of the query covariance, and L that of the query precision (`precision`).
double opacity_change(const RawSplat& s, const Block& lh, const Block& precision) {
  if (s.l.variant.beta_opacity != BetaOpacity::tanh) return 0;
  const CounterRandom random(0, 0);
  const Slicer slicer(s.model, s.i);
  const auto factor = [&](const Block& residual) {
    QueryValues y{};
    for (int i = 0; i < s.l.query; ++i) y[static_cast<std::size_t>(i)] = residual.e[i][0];
    return std::exp(slicer.log_factor(y));
  };
  double sum = 0;
  for (int k = 0; k < kOpacityQueries; ++k) {
    Block xi(s.l.query, 1);
    for (int i = 0; i < s.l.query; ++i)
      xi.e[i][0] = random.uniform(static_cast<std::uint32_t>(k), static_cast<std::uint32_t>(i), -1.0, 1.0);
    const Block other = precision.transposed() * (lh * xi);
    sum += std::abs(factor(xi) - factor(other));
  }
  return sum / kOpacityQueries;
}

SplatModel like(const SplatModel& model, ModelVariant variant) {
  variant.rot_mode = RotMode::taylor1;
  variant.cov_param = CovParam::cholesky;
  variant.cov_mode = CovMode::upper;
  if (variant.beta_opacity != BetaOpacity::tanh) variant.beta_cond = BetaCond::off;
  SplatModel out(model.dim, model.count, variant);
  const ParameterLayout from = model.layout(), to = out.layout();
  const auto copy = [&](int target, int source, int rows) {
    for (int r = 0; r < rows; ++r) std::ranges::copy(model.row(source + r), out.row(target + r).begin());
  };
  copy(0, 0, to.query_beta);
  copy(to.query_beta, from.query_beta, to.mean - to.query_beta);
  copy(to.mean, from.mean, to.query);
  return out;
}

// Stores the parameters of the covariance factor of a splat: the spatial frame, and the entries of the query
// rows up to the diagonal. `entry(i, j)` returns entry j of query row i, where columns 0 to 2 are the spatial
// ones.
template <class Entry>
void put(SplatModel& model, std::size_t splat, const Block& frame, Entry entry) {
  const ParameterLayout l = model.layout();
  const auto set = [&](int row, double value) { model.row(row)[splat] = static_cast<float>(value); };
  for (int row = 0; row < l.dim; ++row) {
    const auto value = [&](int column) { return row < 3 ? frame.e[row][column] : entry(row - 3, column); };
    for (int j = 0; j < row; ++j) set(l.l_triangle + row * (row - 1) / 2 + j, value(j));
    set(l.scale + row, inverse_softplus_of(value(row)));
  }
}

void note_opacity(Reconditioned& out, double change) {
  out.opacity_mean += change / static_cast<double>(out.model.count);
  out.opacity_most = std::max(out.opacity_most, change);
}

}  // namespace

Reconditioned to_direct(const SplatModel& model) {
  if (model.variant.direct()) fail(ErrorKind::usage, "the model already has direct conditioning");
  if (model.variant.cov_param == CovParam::skew_nd)
    fail(ErrorKind::usage, "a model with cov_param = skew_nd cannot be converted to direct conditioning");
  ModelVariant variant = model.variant;
  variant.conditioning = Conditioning::direct;
  Reconditioned out{like(model, variant)};
  for (std::size_t i = 0; i < model.count; ++i) {
    const RawSplat s(model, i);
    const Block m = spatial_of(s).factor, rows = query_rows(s);
    const std::vector<double> w = weights_of(s);
    Block coupling(s.l.query, 3);
    for (int q = 0; q < s.l.query; ++q) std::copy_n(rows.e[q], 3, coupling.e[q]);
    bool raised = false, indefinite = false;
    const Block query = rows * rows.transposed();
    const Block lh = lower_factor(query, UBS_PIVOT_ABSOLUTE, raised), inverse = lower_inverse(lh);
    const Block precision = inverse.transposed() * inverse, cross = m * coupling.transposed();
    // For a query at the offset x from the query mean, the conditional mean is mu_x + G x, and the
    // conditional covariance is Sigma_x - G X^T (method.md 2.3). G is `gain`, and X is the cross covariance
    // `cross`.
    const Block gain = s.l.variant.cov_mode == CovMode::whiten
                           ? cross * inverse.transposed() * diagonal(w, 1) * inverse
                           : cross * precision * diagonal(w, 1);
    const Block covariance = mirrored_upper(plus(m * m.transposed(), -1, gain * cross.transposed()));
    const Block frame = lower_factor(covariance, least_axis(covariance), indefinite);
    out.indefinite += indefinite;
    const bool weighted = out.model.variant.beta_cond == BetaCond::on;
    const Block moved = weighted ? gain * query * diagonal(w, -1) : gain * query;
    const Block l = lower_factor(precision, UBS_PIVOT_ABSOLUTE, raised);
    const double scale = mean_diagonal(frame);
    put(out.model, i, frame, [&](int q, int j) { return j < 3 ? moved.e[j][q] / scale : l.e[q][j - 3]; });
    note_opacity(out, opacity_change(s, lh, l));
  }
  return out;
}

Reconditioned to_covariance(const SplatModel& model) {
  if (!model.variant.direct()) fail(ErrorKind::usage, "the model does not have direct conditioning");
  ModelVariant variant = model.variant;
  variant.conditioning = Conditioning::covariance;
  Reconditioned out{like(model, variant)};
  std::size_t none = 0;
  for (std::size_t i = 0; i < model.count; ++i) {
    const RawSplat s(model, i);
    const auto [m, scale] = spatial_of(s);
    const Block l = precision_factor(s);
    const std::vector<double> w = weights_of(s);
    bool raised = false, failed = false;
    const Block inverse = lower_inverse(l), query = inverse.transposed() * inverse,
                precision = l * l.transposed();
    Block moved(3, s.l.query);
    for (int q = 0; q < s.l.query; ++q)
      for (int c = 0; c < 3; ++c) moved.e[c][q] = scale * s.triangle(q + 3, c);
    // Find the cross covariance X with X P diag(w) = C diag(w) P, where P is the query precision and C is
    // `moved`. If the result has no weights, the left side is X P.
    const bool weighted = out.model.variant.beta_cond == BetaCond::on;
    const Block gain = moved * diagonal(w, 1) * precision;
    const Block cross = weighted ? gain * diagonal(w, -1) * query : gain * query;
    const Block spatial = mirrored_upper(plus(m * m.transposed(), 1, gain * cross.transposed()));
    const Block frame = lower_factor(spatial, least_axis(spatial), failed);
    const Block coupling = (lower_inverse(frame) * cross).transposed();
    const Block rest =
        lower_factor(plus(query, -1, coupling * coupling.transposed()), UBS_PIVOT_ABSOLUTE, failed);
    none += failed;
    put(out.model, i, frame, [&](int q, int j) { return j < 3 ? coupling.e[q][j] : rest.e[q][j - 3]; });
    note_opacity(out, opacity_change(s, lower_factor(query, UBS_PIVOT_ABSOLUTE, raised), l));
  }
  if (none > 0)
    fail(ErrorKind::data, "{} of {} splats cannot be represented by a covariance of all dimensions", none,
         model.count);
  return out;
}

}  // namespace ubs
