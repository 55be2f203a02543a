// SPDX-License-Identifier: Apache-2.0
// See reduce_splats.hpp. The conditional mean, covariance and opacity of method.md 2.3, 2.4 in double
// precision with the upper-triangle rule of the published files.
#include "host/data/reduce_splats.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>

#include "host/base/error.hpp"
#include "host/base/parallel.hpp"
#include "host/data/foreign_formats.hpp"

namespace ubs {
namespace {

constexpr std::size_t kMaxQuery = 8;
using Query = std::array<double, kMaxQuery>;

double softplus(double x) { return x > 20 ? x : std::log1p(std::exp(x)); }

// One splat with everything that does not depend on the query.
struct Slicer {
  std::size_t c = 0;
  std::array<double, 3> mean{};
  double opacity = 0, beta = 0;
  double sigma_x[3][3] = {}, x[3][kMaxQuery] = {};  // spatial covariance, cross covariance
  double chol[kMaxQuery][kMaxQuery] = {};
  Query mean_q{}, beta_q{}, weight{};

  Slicer(const SplatModel& model, std::size_t i) : c(static_cast<std::size_t>(model.layout().query)) {
    const ParameterLayout l = model.layout();
    const auto at = [&](int row, std::size_t k) {
      return static_cast<double>(model.row(row + static_cast<int>(k))[i]);
    };
    const auto lower = [&](std::size_t r, std::size_t k) { return at(l.l_triangle, r * (r - 1) / 2 + k); };
    opacity = 1 / (1 + std::exp(-at(l.opacity, 0)));
    beta = 4 * std::exp(at(l.beta, 0));
    double m[3][3] = {
        {1, lower(1, 0), lower(2, 0)}, {-lower(1, 0), 1, lower(2, 1)}, {-lower(2, 0), -lower(2, 1), 1}};
    for (std::size_t k = 0; k < 3; ++k) {
      mean[k] = at(l.xyz, k);
      for (auto& row : m) row[k] *= softplus(at(l.scale, k));
    }
    for (std::size_t a = 0; a < 3; ++a)
      for (std::size_t b = 0; b < 3; ++b)
        for (std::size_t k = 0; k < 3; ++k) sigma_x[a][b] += m[a][k] * m[b][k];
    double rows[kMaxQuery][3 + kMaxQuery] = {};  // (Lqx, Lq)
    for (std::size_t q = 0; q < c; ++q) {
      mean_q[q] = at(l.mean, q);
      beta_q[q] = 4 * std::exp(at(l.beta, 1 + q));
      weight[q] = std::min(beta_q[q] / 4, 1.0);
      for (std::size_t k = 0; k < 3 + q; ++k) rows[q][k] = lower(3 + q, k);
      rows[q][3 + q] = softplus(at(l.scale, 3 + q));
      for (std::size_t a = 0; a < 3; ++a)
        for (std::size_t k = 0; k < 3; ++k) x[a][q] += m[a][k] * rows[q][k];
    }
    factorise(rows);
  }

  // Cholesky factor of Sigma_q with the pivots floored relative to their diagonal (method.md 3.5).
  void factorise(const double (&rows)[kMaxQuery][3 + kMaxQuery]) {
    for (std::size_t a = 0; a < c; ++a)
      for (std::size_t b = 0; b <= a; ++b) {
        double sum = 0, diagonal = 0;
        for (std::size_t k = 0; k < 3 + c; ++k) sum += rows[a][k] * rows[b][k];
        diagonal = sum;
        for (std::size_t k = 0; k < b; ++k) sum -= chol[a][k] * chol[b][k];
        chol[a][b] = a == b ? std::sqrt(std::max(sum, 1e-12 * std::max(diagonal, 1e-30))) : sum / chol[b][b];
      }
  }

  Query forward(Query v) const {
    for (std::size_t a = 0; a < c; ++a) {
      for (std::size_t k = 0; k < a; ++k) v[a] -= chol[a][k] * v[k];
      v[a] /= chol[a][a];
    }
    return v;
  }

  Query solve(const Query& v) const {
    Query y = forward(v);
    for (std::size_t a = c; a-- > 0;) {
      for (std::size_t k = a + 1; k < c; ++k) y[a] -= chol[k][a] * y[k];
      y[a] /= chol[a][a];
    }
    return y;
  }

  struct Slice {
    double opacity = 0;
    std::array<double, 3> mean{};
    double covariance[3][3] = {};
  };

  Slice at(const Query& q) const {
    Slice s;
    Query d{};
    for (std::size_t k = 0; k < c; ++k) d[k] = q[k] - mean_q[k];
    const Query y = forward(d);
    double exponent = 0;
    for (std::size_t k = 0; k < c; ++k)
      exponent += beta_q[k] * std::max(std::numbers::ln2 - softplus(2 * y[k] * y[k]), -15.942385);
    s.opacity = opacity * std::exp(exponent);
    s.mean = mean;
    for (std::size_t a = 0; a < 3; ++a) {
      Query row{};
      std::copy_n(x[a], c, row.begin());
      Query g = solve(row);  // row a of X P, then its columns are weighted
      for (std::size_t k = 0; k < c; ++k) {
        g[k] *= weight[k];
        s.mean[a] += g[k] * d[k];
      }
      for (std::size_t b = a; b < 3; ++b) {
        double v = sigma_x[a][b];
        for (std::size_t k = 0; k < c; ++k) v -= g[k] * x[b][k];
        s.covariance[a][b] = s.covariance[b][a] = v;
      }
    }
    return s;
  }
};

std::vector<std::array<double, 3>> sphere_directions() {
  constexpr int kDirections = 32;
  std::vector<std::array<double, 3>> directions;
  for (int i = 0; i < kDirections; ++i) {
    const double z = 1 - (2 * i + 1.0) / kDirections, r = std::sqrt(1 - z * z);
    const double angle = i * std::numbers::pi * (3 - std::sqrt(5.0));  // the golden angle
    directions.push_back({r * std::cos(angle), r * std::sin(angle), z});
  }
  return directions;
}

struct Reduced {
  double opacity = 0;
  std::array<double, 3> mean{};
  double covariance[3][3] = {};
};

// Moments of the mixture of the slices, weighted with their opacities.
Reduced combine(const std::vector<Slicer::Slice>& slices, const std::string& rule) {
  double sum = 0, squares = 0, largest = 0;
  for (const auto& s : slices) {
    sum += s.opacity, squares += s.opacity * s.opacity;
    largest = std::max(largest, s.opacity);
  }
  Reduced r;
  if (!(sum > 0)) return r;
  r.opacity = rule == "mean"       ? sum / static_cast<double>(slices.size())
              : rule == "weighted" ? squares / sum
                                   : largest;
  for (const auto& s : slices)
    for (std::size_t k = 0; k < 3; ++k) r.mean[k] += s.opacity / sum * s.mean[k];
  for (const auto& s : slices)
    for (std::size_t a = 0; a < 3; ++a)
      for (std::size_t b = 0; b < 3; ++b)
        r.covariance[a][b] +=
            s.opacity / sum * (s.covariance[a][b] + (s.mean[a] - r.mean[a]) * (s.mean[b] - r.mean[b]));
  return r;
}

// Eigenvectors as a proper rotation -> quaternion w x y z.
std::array<float, 4> quaternion(const cv::Matx33d& r) {
  const double trace = r(0, 0) + r(1, 1) + r(2, 2);
  std::array<double, 4> q{1 + trace, 1 + 2 * r(0, 0) - trace, 1 + 2 * r(1, 1) - trace,
                          1 + 2 * r(2, 2) - trace};
  const std::size_t largest = static_cast<std::size_t>(std::ranges::max_element(q) - q.begin());
  const double products[4][4] = {{q[0], r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1)},
                                 {r(2, 1) - r(1, 2), q[1], r(0, 1) + r(1, 0), r(0, 2) + r(2, 0)},
                                 {r(0, 2) - r(2, 0), r(0, 1) + r(1, 0), q[2], r(1, 2) + r(2, 1)},
                                 {r(1, 0) - r(0, 1), r(0, 2) + r(2, 0), r(1, 2) + r(2, 1), q[3]}};
  std::array<float, 4> result{};
  for (std::size_t k = 0; k < 4; ++k)
    result[k] = static_cast<float>(products[largest][k] / std::sqrt(4 * q[largest]));
  return result;
}

void store(ImportedSplats& out, std::size_t i, const Reduced& r, double beta) {
  cv::Matx33d covariance, vectors;
  for (int a = 0; a < 3; ++a)
    for (int b = 0; b < 3; ++b) covariance(a, b) = r.covariance[a][b];
  cv::Vec3d values;
  cv::eigen(covariance, values, vectors);  // rows are eigenvectors
  cv::Matx33d rotation = vectors.t();
  if (cv::determinant(rotation) < 0)
    for (int a = 0; a < 3; ++a) rotation(a, 2) = -rotation(a, 2);
  out.rotations[i] = quaternion(rotation);
  const double ratio = support_ratio(beta);
  for (std::size_t k = 0; k < 3; ++k) {
    // An indefinite slice has no thickness along that axis; a thousandth of the longest stands for it.
    const double variance = std::max({values[static_cast<int>(k)], 1e-6 * values[0], 1e-30});
    out.log_scales[i][k] = static_cast<float>(0.5 * std::log(variance) - std::log(ratio));
    out.positions[i][k] = static_cast<float>(r.mean[k]);
  }
  out.opacity_logits[i] = logit_of(r.opacity);
}

}  // namespace

double support_ratio(double beta) { return std::sqrt(2 * beta + 1.49); }

ImportedSplats reduce_splats(const SplatModel& model, const ReduceOptions& options) {
  if (options.opacity != "mean" && options.opacity != "weighted" && options.opacity != "max")
    fail(ErrorKind::usage, "reduction '{}': choose mean, weighted or max", options.opacity);
  const ParameterLayout layout = model.layout();
  const bool directional = layout.query >= 3,
             timed = layout.query == 1 || layout.query == 2 || layout.query >= 4;
  const std::size_t time_at = directional ? 3 : 0;
  ImportedSplats out;
  out.resize(model.count);
  const auto directions = sphere_directions();
  parallel_for((model.count + 255) / 256, [&](std::size_t block) {
    std::vector<Slicer::Slice> slices;
    for (std::size_t i = block * 256; i < std::min(model.count, (block + 1) * 256); ++i) {
      const Slicer slicer(model, i);
      slices.clear();
      const std::size_t views = !directional                 ? 1
                                : options.viewpoints.empty() ? directions.size()
                                                             : options.viewpoints.size();
      for (std::size_t v = 0; v < views; ++v) {
        Query q{};
        if (directional && options.viewpoints.empty()) std::copy_n(directions[v].begin(), 3, q.begin());
        if (directional && !options.viewpoints.empty()) {
          double norm = 0;
          for (std::size_t k = 0; k < 3; ++k) {
            q[k] = slicer.mean[k] - options.viewpoints[v][k];
            norm += q[k] * q[k];
          }
          for (std::size_t k = 0; k < 3; ++k) q[k] /= std::max(1e-12, std::sqrt(norm));
        }
        if (timed) q[time_at] = options.time;
        slices.push_back(slicer.at(q));
      }
      store(out, i, combine(slices, options.opacity), slicer.beta);
      for (std::size_t k = 0; k < 3; ++k)
        out.sh[3 * i + k] =
            static_cast<float>((model.row(layout.rgb + static_cast<int>(k))[i] - 0.5) / kShC0);
    }
  });
  for (std::size_t i = 0; i < out.count(); ++i)
    if (sigmoid_of(out.opacity_logits[i]) < options.least_opacity)
      out.opacity_logits[i] = std::numeric_limits<float>::quiet_NaN();
  clean(out);
  for (auto& s : out.report.skipped)
    if (s.why == "opacity not finite")
      s.why = fmt::format("opacity below {:.4f} from every direction", options.least_opacity);
  return out;
}

}  // namespace ubs
