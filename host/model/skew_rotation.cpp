// SPDX-License-Identifier: Apache-2.0
// This file implements skew_rotation.hpp. Let K = R diag(s), and let B(omega) = I + omega omega^T -
// [omega]_x, which equals (1 + |omega|^2) (I + A)^-1. The covariance K K^T can be written as required, with
// this omega, if the rows of G = B K are orthogonal. The Levenberg-Marquardt method minimises the three
// cosines of the angles between the rows, from several starting points. If the cosines do not reach zero from
// any of them, the function uses a compromise: the omega with the smallest -ln det C, where C is the matrix
// of the cosines.
#include "host/model/skew_rotation.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "host/base/philox.hpp"
#include "host/base/vector3.hpp"

namespace ubs {
namespace {

using Mat3 = std::array<Vec3, 3>;  // rows

constexpr double kSolved = 1e-9;  // cosines up to this count as zero; far below the precision of float32
constexpr int kRelabelled = 12;   // maximum number of starting points from relabelled_starts()
constexpr int kRandom = 24;       // number of random starting points, which are tried after these
constexpr int kIterations = 60;   // maximum number of Levenberg-Marquardt iterations per starting point
constexpr double kExactBarrier = 1e-12;   // fits with a smaller barrier (see Misfit) count as exact
constexpr std::size_t kCompromises = 10;  // number of starting points of the search for a compromise

Mat3 product(const Mat3& a, const Mat3& b) {
  Mat3 c{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      for (std::size_t k = 0; k < 3; ++k) c[i][j] += a[i][k] * b[k][j];
  return c;
}

Mat3 rotation_matrix(const std::array<double, 4>& q) {
  const auto [w, x, y, z] = q;
  return {{{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
           {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
           {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}}};
}

Mat3 cross_matrix(const Vec3& v) { return {{{0, -v[2], v[1]}, {v[2], 0, -v[0]}, {-v[1], v[0], 0}}}; }

// Returns B(omega).
Mat3 inverse_form(const Vec3& w) {
  Mat3 b = cross_matrix(w);
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) b[i][j] = (i == j ? 1.0 : 0.0) + w[i] * w[j] - b[i][j];
  return b;
}

// Returns dB / d omega_k.
Mat3 inverse_form_derivative(const Vec3& w, std::size_t k) {
  Vec3 e{};
  e[k] = 1;
  Mat3 d = cross_matrix(e);
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) d[i][j] = e[i] * w[j] + w[i] * e[j] - d[i][j];
  return d;
}

constexpr std::array<std::array<std::size_t, 2>, 3> kPairs{{{0, 1}, {0, 2}, {1, 2}}};

Vec3 cosines(const Mat3& g) {
  Vec3 r{};
  for (std::size_t p = 0; p < 3; ++p) {
    const Vec3 &a = g[kPairs[p][0]], &b = g[kPairs[p][1]];
    r[p] = dot(a, b) / std::sqrt(dot(a, a) * dot(b, b));
  }
  return r;
}

Mat3 jacobian(const Mat3& k, const Vec3& w, const Mat3& g, const Vec3& r) {
  Mat3 j{};
  for (std::size_t c = 0; c < 3; ++c) {
    const Mat3 d = product(inverse_form_derivative(w, c), k);
    for (std::size_t p = 0; p < 3; ++p) {
      const std::size_t a = kPairs[p][0], b = kPairs[p][1];
      const double aa = dot(g[a], g[a]), bb = dot(g[b], g[b]);
      j[p][c] = (dot(d[a], g[b]) + dot(g[a], d[b])) / std::sqrt(aa * bb) -
                r[p] * (dot(g[a], d[a]) / aa + dot(g[b], d[b]) / bb);
    }
  }
  return j;
}

// Solves m x = y with Cramer's rule. Returns false if `m` is singular.
bool solve(const Mat3& m, const Vec3& y, Vec3& x) {
  const auto det = [](const Mat3& a) {
    return a[0][0] * (a[1][1] * a[2][2] - a[1][2] * a[2][1]) -
           a[0][1] * (a[1][0] * a[2][2] - a[1][2] * a[2][0]) +
           a[0][2] * (a[1][0] * a[2][1] - a[1][1] * a[2][0]);
  };
  const double d = det(m);
  if (!(std::abs(d) > 1e-300)) return false;
  for (std::size_t c = 0; c < 3; ++c) {
    Mat3 replaced = m;
    for (std::size_t i = 0; i < 3; ++i) replaced[i][c] = y[i];
    x[c] = det(replaced) / d;
  }
  return true;
}

// Improves omega (`w`) with the Levenberg-Marquardt method and returns the largest remaining cosine.
double minimise(const Mat3& k, Vec3& w) {
  double lambda = 1e-3;
  Mat3 g = product(inverse_form(w), k);
  Vec3 r = cosines(g);
  for (int i = 0; i < kIterations && dot(r, r) > kSolved * kSolved && lambda < 1e10; ++i) {
    const Mat3 j = jacobian(k, w, g, r);
    Mat3 normal{};
    Vec3 gradient{}, step{};
    for (std::size_t a = 0; a < 3; ++a) {
      for (std::size_t b = 0; b < 3; ++b)
        for (std::size_t p = 0; p < 3; ++p) normal[a][b] += j[p][a] * j[p][b];
      for (std::size_t p = 0; p < 3; ++p) gradient[a] += j[p][a] * r[p];
    }
    for (std::size_t a = 0; a < 3; ++a) normal[a][a] = normal[a][a] * (1 + lambda) + 1e-12;
    if (!solve(normal, gradient, step)) break;
    const Vec3 next{w[0] - step[0], w[1] - step[1], w[2] - step[2]};
    const Mat3 next_g = product(inverse_form(next), k);
    const Vec3 next_r = cosines(next_g);
    if (dot(next_r, next_r) < dot(r, r)) {
      w = next, g = next_g, r = next_r;
      lambda = std::max(lambda / 10, 1e-12);
    } else {
      lambda *= 8;
    }
  }
  return std::max({std::abs(r[0]), std::abs(r[1]), std::abs(r[2])});
}

// Misfit computes the error of an omega and the best scales for it. `r` contains the remaining cosines
// between the rows of G. C is the matrix of these cosines, and D = G G^T. Apart from a common factor, the
// scales are s_i^2 = D_ii / sqrt((C^-1)_ii). This balances two kinds of errors: with s_i^2 = D_ii, the
// ellipsoid would never be too thin, but could be much too thick; with s_i^2 = 1 / (D^-1)_ii, it would never
// be too thick, but could be much too thin.
struct Misfit {
  double barrier = std::numeric_limits<double>::infinity();  // -ln det C, which is 0 for an exact fit
  double error = std::numeric_limits<double>::infinity();    // SkewFactors::error
  Vec3 shrink{1, 1, 1};                                      // factors by which the D_ii are multiplied

  explicit Misfit(const Vec3& r) {
    const double a = r[0], b = r[1], c = r[2];
    const double det = 1 + 2 * a * b * c - a * a - b * b - c * c;
    if (!(det > 1e-300)) return;
    barrier = -std::log(det);
    const Mat3 inverse{{{(1 - c * c) / det, (b * c - a) / det, (a * c - b) / det},
                        {(b * c - a) / det, (1 - b * b) / det, (a * b - c) / det},
                        {(a * c - b) / det, (a * b - c) / det, (1 - a * a) / det}}};
    double sum = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      shrink[i] = 1 / std::sqrt(inverse[i][i]);
      for (std::size_t j = 0; j < 3; ++j) {
        const double e = inverse[i][j] / std::pow(inverse[i][i] * inverse[j][j], 0.25);
        sum += std::pow(e - (i == j ? 1.0 : 0.0), 2);
      }
    }
    error = std::sqrt(sum);
  }
};

double barrier_at(const Mat3& k, const Vec3& w) {
  // The scales that belong to a very large omega are too small to be useful in float32.
  if (!(dot(w, w) < 1e6)) return std::numeric_limits<double>::infinity();
  return Misfit(cosines(product(inverse_form(w), k))).barrier;
}

// Improves omega (`w`) by minimising the barrier (see Misfit) with the simplex method of Nelder and Mead, and
// returns the barrier. This is needed for the few covariances that cannot be represented exactly. For them
// the cosines do not reach zero, and minimising the squares of the cosines can give a worse result than
// minimising the barrier.
double minimise_barrier(const Mat3& k, Vec3& w) {
  struct Corner {
    double value;
    Vec3 at;
  };
  std::array<Corner, 4> simplex;
  for (std::size_t i = 0; i < 4; ++i) {
    Vec3 at = w;
    if (i > 0) at[i - 1] += 0.1;
    simplex[i] = {barrier_at(k, at), at};
  }
  const auto along = [&](const Vec3& centre, double t) {
    Vec3 at{};
    for (std::size_t j = 0; j < 3; ++j) at[j] = centre[j] + t * (simplex[3].at[j] - centre[j]);
    return Corner{barrier_at(k, at), at};
  };
  for (int step = 0; step < 250; ++step) {
    std::ranges::sort(simplex, {}, &Corner::value);
    if (simplex[3].value - simplex[0].value < 1e-10) break;
    Vec3 centre{};
    for (std::size_t i = 0; i < 3; ++i)
      for (std::size_t j = 0; j < 3; ++j) centre[j] += simplex[i].at[j] / 3;
    const Corner reflected = along(centre, -1);
    if (reflected.value < simplex[0].value) {
      const Corner expanded = along(centre, -2);
      simplex[3] = expanded.value < reflected.value ? expanded : reflected;
    } else if (reflected.value < simplex[2].value) {
      simplex[3] = reflected;
    } else {
      const Corner contracted = along(centre, reflected.value < simplex[3].value ? -0.5 : 0.5);
      if (contracted.value < std::min(reflected.value, simplex[3].value)) {
        simplex[3] = contracted;
        continue;
      }
      for (std::size_t i = 1; i < 4; ++i) {
        for (std::size_t j = 0; j < 3; ++j) simplex[i].at[j] = (simplex[i].at[j] + simplex[0].at[j]) / 2;
        simplex[i].value = barrier_at(k, simplex[i].at);
      }
    }
  }
  const Corner& best = *std::ranges::min_element(simplex, {}, &Corner::value);
  w = best.at;
  return best.value;
}

// Relabels the axes of the rotation, that is, permutes them and changes their signs, in all ways that give a
// rotation again. Returns axis * tan(angle) of those whose angle is below 85 degrees, smallest angles first.
std::vector<Vec3> relabelled_starts(const Mat3& rotation) {
  struct Start {
    double cosine;
    Vec3 omega;
  };
  std::vector<Start> starts;
  constexpr std::size_t kOrders[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {1, 0, 2}, {0, 2, 1}, {2, 1, 0}};
  for (std::size_t o = 0; o < 6; ++o)
    for (int signs = 0; signs < 8; ++signs) {
      const bool odd_signs = (signs & 1) ^ (signs >> 1 & 1) ^ (signs >> 2 & 1);
      if (odd_signs != (o >= 3)) continue;  // proper rotations only
      Mat3 m{};
      for (std::size_t r = 0; r < 3; ++r)
        for (std::size_t c = 0; c < 3; ++c)
          m[r][c] = rotation[r][kOrders[o][c]] * ((signs >> c & 1) ? -1.0 : 1.0);
      const double cosine = (m[0][0] + m[1][1] + m[2][2] - 1) / 2;
      if (cosine < 0.0872) continue;
      // The skew part is axis * sin(angle).
      const Vec3 axis_sin{(m[2][1] - m[1][2]) / 2, (m[0][2] - m[2][0]) / 2, (m[1][0] - m[0][1]) / 2};
      starts.push_back({cosine, {axis_sin[0] / cosine, axis_sin[1] / cosine, axis_sin[2] / cosine}});
    }
  std::ranges::stable_sort(starts, std::greater{}, &Start::cosine);
  std::vector<Vec3> omegas;
  for (const Start& s : starts)
    if (omegas.size() < kRelabelled) omegas.push_back(s.omega);
  return omegas;
}

}  // namespace

SkewFactors fit_skew_rotation(const std::array<double, 4>& rotation, const std::array<double, 3>& scale) {
  const double unit = *std::ranges::max_element(scale);  // divides the scales, so that the largest one is 1
  const Mat3 matrix = rotation_matrix(rotation);
  Mat3 k = matrix;
  for (Vec3& row : k)
    for (std::size_t c = 0; c < 3; ++c) row[c] *= scale[c] / unit;

  std::vector<Vec3> starts = relabelled_starts(matrix);
  const CounterRandom random(0, 0x736b6577);
  for (std::uint32_t i = 0; i < kRandom; ++i)
    starts.push_back({1.5 * random.normal(i, 0), 1.5 * random.normal(i, 1), 1.5 * random.normal(i, 2)});
  struct Candidate {
    double barrier;
    Vec3 omega;
  };
  std::vector<Candidate> candidates;
  for (const Vec3& start : starts) {
    Vec3 omega = start;
    minimise(k, omega);
    candidates.push_back({barrier_at(k, omega), omega});
    if (candidates.back().barrier < kExactBarrier) break;
    candidates.push_back({barrier_at(k, start), start});
  }
  std::ranges::stable_sort(candidates, {}, &Candidate::barrier);
  if (candidates[0].barrier >= kExactBarrier) {
    candidates.resize(std::min(candidates.size(), kCompromises));
    for (Candidate& c : candidates) c.barrier = minimise_barrier(k, c.omega);
  }
  const Vec3 best = std::ranges::min_element(candidates, {}, &Candidate::barrier)->omega;
  const Mat3 g = product(inverse_form(best), k);
  const Misfit misfit(cosines(g));
  SkewFactors result{best, {}, misfit.error};
  for (std::size_t i = 0; i < 3; ++i)
    result.scale[i] = unit * std::sqrt(dot(g[i], g[i]) * misfit.shrink[i]) / (1 + dot(best, best));
  return result;
}

}  // namespace ubs
