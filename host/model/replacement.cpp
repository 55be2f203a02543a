// SPDX-License-Identifier: Apache-2.0
// This file implements replacement.hpp. The replacement starts as the marginal of the splat, which has the
// rows of L of the remaining dimensions (docs/method.md, section 2.1). If only the last dimensions are
// removed, this does not change the conditioning on the remaining ones. Then the opacity and the mean, and
// for N = 3 also the covariance, are replaced by weighted means over the views.
#include "host/model/replacement.hpp"

#include <algorithm>
#include <cmath>

#include "host/formats/covariance_axes.hpp"
#include "host/model/skew_rotation.hpp"
#include "host/scene/slice.hpp"

namespace ubs::reduce {
namespace {

constexpr double kMaxOpacity = 1 - 1e-6;

bool has_direction(int dim) { return dim >= 6; }
int value_count(int dim) { return dim - 3 - (has_direction(dim) ? 3 : 0); }

// Returns the query dimensions of a splat of N = `from` that a splat of N = `to` has too.
std::vector<int> kept_query(int from, int to) {
  std::vector<int> kept;
  if (has_direction(to)) kept = {0, 1, 2};
  for (int v = 0; v < value_count(to); ++v) kept.push_back((has_direction(from) ? 3 : 0) + v);
  return kept;
}

double inverse_softplus(double y) { return y + std::log(-std::expm1(-std::max(y, 1e-7))); }

// Returns a model that consists of this single splat.
SplatModel single_splat(const SplatModel& model, std::size_t splat) {
  SplatModel one(model.dim, 1, model.variant);
  for (int r = 0; r < model.layout().count; ++r) one.row(r)[0] = model.row(r)[splat];
  return one;
}

// Returns the index of an element of L below the diagonal, in the order in which the elements are stored.
int triangle(int row, int column) { return row * (row - 1) / 2 + column; }

// Sets the rows of L of the remaining query dimensions. Each row has three spatial columns, which are copied,
// and one column for each query dimension. If columns of removed dimensions are not zero, the remaining query
// columns must account for them. Therefore they are computed as the Cholesky factor of the matrix of the dot
// products of the original rows, without the spatial columns.
void marginal_rows(const SplatModel& from, SplatModel& to, const std::vector<int>& kept) {
  const ParameterLayout a = from.layout(), b = to.layout();
  const auto entry = [&](int q, int column) -> double {
    const int row = 3 + q;
    if (column < row) return from.row(a.l_triangle + triangle(row, column))[0];
    const double raw = from.row(a.scale + row)[0];
    return column == row ? (raw > 20 ? raw : std::log1p(std::exp(raw))) : 0.0;
  };
  const auto stays = [&](int q) { return std::ranges::find(kept, q) != kept.end(); };
  // True if the removed columns are all zero, so that the remaining rows can be copied exactly.
  bool untouched = true;
  for (const int q : kept)
    for (int c = 0; c < q; ++c) untouched = untouched && (stays(c) || entry(q, 3 + c) == 0);
  double factor[kMaxQuery][kMaxQuery] = {};
  for (int i = 0; i < static_cast<int>(kept.size()); ++i) {
    const int row = 3 + i, old = 3 + kept[static_cast<std::size_t>(i)];
    for (int c = 0; c < 3; ++c)
      to.row(b.l_triangle + triangle(row, c))[0] = from.row(a.l_triangle + triangle(old, c))[0];
    for (int j = 0; j <= i; ++j) {
      double sum = 0;
      for (int c = 3; c < 3 + a.query; ++c)
        sum += entry(kept[static_cast<std::size_t>(i)], c) * entry(kept[static_cast<std::size_t>(j)], c);
      for (int k = 0; k < j; ++k) sum -= factor[i][k] * factor[j][k];
      factor[i][j] = i == j ? std::sqrt(std::max(sum, 1e-30)) : sum / factor[j][j];
    }
    if (untouched) {
      for (int j = 0; j < i; ++j)
        to.row(b.l_triangle + triangle(row, 3 + j))[0] =
            from.row(a.l_triangle + triangle(old, 3 + kept[static_cast<std::size_t>(j)]))[0];
      to.row(b.scale + row)[0] = from.row(a.scale + old)[0];
    } else {
      for (int j = 0; j < i; ++j)
        to.row(b.l_triangle + triangle(row, 3 + j))[0] = static_cast<float>(factor[i][j]);
      to.row(b.scale + row)[0] = static_cast<float>(inverse_softplus(factor[i][i]));
    }
  }
}

// Returns the marginal of a splat: a splat of N = `dim` without the removed query dimensions.
SplatModel marginal(const SplatModel& from, int dim) {
  SplatModel to(dim, 1, from.variant);
  const ParameterLayout a = from.layout(), b = to.layout();
  const std::vector<int> kept = kept_query(from.dim, dim);
  const auto copy = [&](int target, int source, int rows) {
    for (int r = 0; r < rows; ++r) to.row(target + r)[0] = from.row(source + r)[0];
  };
  copy(b.xyz, a.xyz, 3);
  copy(b.rgb, a.rgb, a.opacity - a.rgb);
  copy(b.opacity, a.opacity, 1);
  copy(b.beta, a.beta, a.query_beta - a.beta);
  copy(b.scale, a.scale, 3);
  copy(b.l_triangle, a.l_triangle, 3);
  for (int i = 0; i < static_cast<int>(kept.size()); ++i) {
    const int q = kept[static_cast<std::size_t>(i)];
    if (from.variant.has_query_beta()) copy(b.query_beta + i, a.query_beta + q, 1);
    copy(b.mean + i, a.mean + q, 1);
  }
  marginal_rows(from, to, kept);
  return to;
}

// Returns whether removing the query dimensions that N = `dim` does not have has no effect. This is the case
// if exp(raw query beta) of these dimensions is zero in float32, and no remaining dimension is correlated
// with them. Then, for every query, they multiply the opacity by exactly 1 and change neither the mean nor
// the covariance.
bool without_effect(const SplatModel& from, int dim) {
  const ParameterLayout l = from.layout();
  const std::vector<int> kept = kept_query(from.dim, dim);
  const auto stays = [&](int q) { return std::ranges::find(kept, q) != kept.end(); };
  for (int q = 0; q < l.query; ++q) {
    if (stays(q)) continue;
    if (std::exp(from.row(l.query_beta + q)[0]) != 0.0f) return false;
    for (int other = 0; other < l.query; ++other) {
      if (!stays(other)) continue;
      const int row = 3 + std::max(q, other), column = 3 + std::min(q, other);
      if (from.row(l.l_triangle + triangle(row, column))[0] != 0.0f) return false;
    }
    if (kept.empty()) continue;
    for (int c = 0; c < 3; ++c)
      if (from.row(l.l_triangle + triangle(3 + q, c))[0] != 0.0f) return false;
  }
  return true;
}

QueryValues query_of(const SplatModel& splat, const Camera& camera) {
  QueryValues query{};
  std::size_t at = 0;
  if (has_direction(splat.dim)) {
    const std::array<double, 3> centre = camera.centre();
    double norm = 0;
    for (; at < 3; ++at) {
      query[at] = splat.row(static_cast<int>(at))[0] - centre[at];
      norm += query[at] * query[at];
    }
    norm = std::max(1e-12, std::sqrt(norm));
    for (std::size_t k = 0; k < 3; ++k) query[k] /= norm;
  }
  for (int v = 0; v < value_count(splat.dim); ++v)
    query[at++] = v == 0 ? camera.time
                  : static_cast<std::size_t>(v) <= camera.extra.size()
                      ? camera.extra[static_cast<std::size_t>(v - 1)]
                      : 0.0;
  return query;
}

// Seen describes a splat in a view in which it is visible.
struct Seen {
  Slice slice;
  double weight = 0;  // maximum blended weight
  double px = 0;      // size in the image of one unit of length at the depth of the splat [px]
};

double depth_of(const Camera& camera, const std::array<double, 3>& p) {
  double z = camera.translation[2];
  for (std::size_t k = 0; k < 3; ++k) z += camera.rotation[6 + k] * p[k];
  return std::max(z, 1e-6);
}

std::vector<Seen> slices_of(const SplatModel& splat, const SplatViews& views) {
  const Slicer slicer(splat, 0);
  std::vector<Seen> seen;
  for (std::size_t v = 0; v < views.cameras.size(); ++v) {
    if (!(views.weights[v] > 0)) continue;
    const Camera& camera = views.cameras[v];
    const Slice slice = slicer.at(query_of(splat, camera));
    seen.push_back({slice, views.weights[v], std::max(camera.fx, camera.fy) / depth_of(camera, slice.mean)});
  }
  return seen;
}

// Returns an estimate of the maximum change of the falloff of the kernel if the ellipse moves by `shift` and
// stretches by `stretch`, both relative to its size. It is the sum of both, multiplied by the maximum slope
// of the falloff. For a Beta kernel (beta > 0) the slopes are 2 beta (1-r)^(beta-1) sqrt(r) for `shift` and
// beta (1-r)^(beta-1) r for `stretch`. If beta is near or below 1, their maxima are at the rim, so r is
// limited to 0.9. For a Gaussian kernel (beta = 0) the slopes are sqrt(r) exp(-r/2) and r exp(-r/2) / 2.
double falloff_change(double beta, double shift, double stretch) {
  double move = std::exp(-0.5), grow = std::exp(-1.0);
  if (beta > 0) {
    const double r1 = std::min(0.9, beta > 0.5 ? 1 / (2 * beta - 1) : 1.0), r2 = std::min(0.9, 1 / beta);
    const auto slope = [&](double r) { return beta * std::pow(1 - r, beta - 1); };
    move = 2 * slope(std::max(r1, 1e-9)) * std::sqrt(std::max(r1, 1e-9));
    grow = slope(r2) * r2;
  }
  return std::min(1.0, move * shift + grow * stretch);
}

struct Difference {
  double shift = 0, stretch = 0;  // relative to the size of the ellipse including the blur
  double distance = 0;            // distance between the means [world units]
};

// Compares two slices. d is the difference of their means, A and B are their covariances, and L L^T is A plus
// the blur (the variance `blur` on the diagonal). `shift` is the length of L^-1 d, and `stretch` is the
// Frobenius norm of L^-1 (B - A) L^-T.
Difference compare(const Slice& a, const Slice& b, double blur) {
  double chol[3][3] = {}, middle[3][3], d[3];
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c <= r; ++c) {
      double sum = a.covariance[r][c] + (r == c ? blur : 0);
      const double diagonal = sum;
      for (int k = 0; k < c; ++k) sum -= chol[r][k] * chol[c][k];
      chol[r][c] = r == c ? std::sqrt(std::max(sum, 1e-9 * std::abs(diagonal) + 1e-300)) : sum / chol[c][c];
    }
  const auto solve = [&](double* x) {  // replaces x by L^-1 x
    for (int r = 0; r < 3; ++r) {
      for (int k = 0; k < r; ++k) x[r] -= chol[r][k] * x[k];
      x[r] /= chol[r][r];
    }
  };
  Difference out;
  for (std::size_t k = 0; k < 3; ++k) {
    d[k] = b.mean[k] - a.mean[k];
    out.distance += d[k] * d[k];
  }
  out.distance = std::sqrt(out.distance);
  solve(d);
  out.shift = std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
  for (int c = 0; c < 3; ++c) {
    double column[3];
    for (int r = 0; r < 3; ++r) column[r] = b.covariance[r][c] - a.covariance[r][c];
    solve(column);
    for (int r = 0; r < 3; ++r) middle[c][r] = column[r];
  }
  double square = 0;
  for (int r = 0; r < 3; ++r) {
    double row[3];
    for (int c = 0; c < 3; ++c) row[c] = middle[c][r];
    solve(row);
    for (const double v : row) square += v * v;
  }
  out.stretch = std::sqrt(square);
  return out;
}

DimensionEffect effect_of(const std::vector<Seen>& before, const std::vector<Seen>& after, double beta,
                          double eps2d) {
  DimensionEffect effect;
  double low = 1e300, high = 0;
  for (std::size_t v = 0; v < before.size(); ++v) {
    const Slice &a = before[v].slice, &b = after[v].slice;
    const double px = before[v].px;
    const Difference difference = compare(a, b, eps2d / (px * px));
    const double factor = b.opacity > 0 ? a.opacity / b.opacity : 0;
    low = std::min(low, factor);
    high = std::max(high, factor);
    effect.shift_px = std::max(effect.shift_px, px * difference.distance);
    const double alpha = std::abs(a.opacity - b.opacity) +
                         a.opacity * falloff_change(beta, difference.shift, difference.stretch);
    // If the centre of the splat is at the centre of a pixel, the transmittance in front of the splat is its
    // weight divided by its opacity.
    const double in_front = a.opacity > 0 ? std::min(1.0, before[v].weight / a.opacity) : 1.0;
    effect.change = std::max(effect.change, in_front * alpha);
  }
  effect.opacity = high > low ? high - low : 0;
  return effect;
}

// Replaces the opacity and the mean of the splat by constants that fit the slices `before` best on average
// over the views. Each view is weighted by the contribution of the splat to it.
void fit_constants(SplatModel& splat, const std::vector<Seen>& before, const std::vector<Seen>& after) {
  const ParameterLayout l = splat.layout();
  double cross = 0, square = 0, sum = 0;
  std::array<double, 3> shift{};
  for (std::size_t v = 0; v < before.size(); ++v) {
    const double w = before[v].weight;
    cross += w * before[v].slice.opacity * after[v].slice.opacity;
    square += w * after[v].slice.opacity * after[v].slice.opacity;
    sum += w;
    for (std::size_t k = 0; k < 3; ++k) shift[k] += w * (before[v].slice.mean[k] - after[v].slice.mean[k]);
  }
  const double base = sigmoid(splat.row(l.opacity)[0]);
  const double opacity = std::clamp(square > 0 ? base * cross / square : base, 1e-12, kMaxOpacity);
  splat.row(l.opacity)[0] = static_cast<float>(std::log(opacity / (1 - opacity)));
  for (int k = 0; k < 3; ++k)
    splat.row(l.xyz + k)[0] =
        static_cast<float>(splat.row(l.xyz + k)[0] + shift[static_cast<std::size_t>(k)] / sum);
}

// Returns a slice whose covariance is the weighted mean over the views. Its opacity and mean are not set.
Slice mean_slice(const std::vector<Seen>& before) {
  Slice mean;
  double sum = 0;
  for (const Seen& seen : before) {
    sum += seen.weight;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) mean.covariance[r][c] += seen.weight * seen.slice.covariance[r][c];
  }
  for (auto& row : mean.covariance)
    for (double& v : row) v /= sum;
  return mean;
}

void set_covariance(SplatModel& splat, const Slice& slice) {
  const ParameterLayout l = splat.layout();
  const CovarianceAxes axes = covariance_axes(slice.covariance);
  std::array<double, 3> scale;
  for (std::size_t k = 0; k < 3; ++k) scale[k] = std::sqrt(axes.variance[k]);
  const SkewFactors factors = fit_skew_rotation(axes.rotation, scale);
  for (std::size_t k = 0; k < 3; ++k) {
    splat.row(l.l_triangle + static_cast<int>(k))[0] = static_cast<float>(factors.skew()[k]);
    splat.row(l.scale + static_cast<int>(k))[0] = static_cast<float>(inverse_softplus(factors.scale[k]));
  }
}

Replacement replace(const SplatModel& splat, int dim, const std::vector<Seen>& before,
                    const SplatViews& views, double beta, double worst) {
  Replacement out{dim, {}, {}};
  SplatModel smaller = marginal(splat, dim);
  fit_constants(smaller, before, slices_of(smaller, views));
  std::vector<Seen> after = slices_of(smaller, views);
  if (dim == 3) {
    const Slice mean = mean_slice(before);
    for (Seen& seen : after)
      std::ranges::copy(&mean.covariance[0][0], &mean.covariance[0][0] + 9, &seen.slice.covariance[0][0]);
  }
  out.effect = effect_of(before, after, beta, views.eps2d);
  if (!(out.effect.change <= worst)) return out;
  if (dim == 3) {
    set_covariance(smaller, mean_slice(before));
    out.effect = effect_of(before, slices_of(smaller, views), beta, views.eps2d);
    if (!(out.effect.change <= worst)) return out;
  }
  if (std::ranges::all_of(smaller.values, [](float v) { return std::isfinite(v); }))
    out.values = smaller.values;
  return out;
}

}  // namespace

std::vector<int> smaller_dims(int dim) {
  std::vector<int> dims;
  for (int to = kMinDim; to < dim; ++to) {
    const bool direction_fits = has_direction(dim) || !has_direction(to);
    const bool values_fit = value_count(to) == 0 || value_count(to) == value_count(dim);
    if (direction_fits && values_fit) dims.push_back(to);
  }
  return dims;
}

std::vector<Replacement> replacements(const SplatModel& model, std::size_t splat, const SplatViews& views,
                                      double worst) {
  const SplatModel one = single_splat(model, splat);
  const bool known =
      Slicer::knows(model.variant) && !model.variant.direct();  // marginal() requires a covariance
  std::vector<Replacement> out;
  std::vector<Seen> before;
  double beta = 0;
  if (known) {
    before = slices_of(one, views);
    beta = Slicer(one, 0).beta();
  }
  for (const int dim : smaller_dims(model.dim)) {
    if (known && without_effect(one, dim)) {
      out.push_back({dim, {}, marginal(one, dim).values});
      out.back().effect.exact = true;
    } else if (!before.empty()) {
      out.push_back(replace(one, dim, before, views, beta, worst));
    }
  }
  return out;
}

}  // namespace ubs::reduce
