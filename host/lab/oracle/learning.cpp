// SPDX-License-Identifier: Apache-2.0
#include "host/lab/oracle/learning.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "host/base/philox.hpp"
#include "host/lab/oracle/splat_formula.hpp"

namespace ubs::oracle {
namespace {

// Returns three standard normal random numbers. The Box-Muller method computes
// them from the four random words of a Philox counter.
std::array<double, 3> normals(const Draw& draw) {
  const auto low = [](std::uint64_t v) { return static_cast<std::uint32_t>(v); };
  const PhiloxCounter words =
      philox4x32_10({draw.number, low(draw.iteration), low(draw.iteration >> 32), draw.purpose},
                    {low(draw.seed), low(draw.seed >> 32)});
  const auto unit = [&](std::size_t k) { return (words[k] + 0.5) * 0x1p-32; };
  const double r0 = std::sqrt(-2 * std::log(unit(0))), r1 = std::sqrt(-2 * std::log(unit(2)));
  const double turn = 2 * std::numbers::pi;
  return {r0 * std::cos(turn * unit(1)), r0 * std::sin(turn * unit(1)), r1 * std::cos(turn * unit(3))};
}

std::vector<double> raw_of(const SplatModel& model, std::size_t splat) {
  std::vector<double> raw;
  for (int r = 0; r < model.layout().count; ++r) raw.push_back(model.row(r)[splat]);
  return raw;
}

}  // namespace

AdamValue adam(AdamValue before, double g, double rate, std::uint64_t step, double beta1, double beta2,
               double epsilon) {
  AdamValue after;
  after.moment1 = beta1 * before.moment1 + (1 - beta1) * g;
  after.moment2 = beta2 * before.moment2 + (1 - beta2) * g * g;
  const double s = static_cast<double>(step);
  after.parameter = before.parameter - rate * after.moment1 / (1 - std::pow(beta1, s)) /
                                           (std::sqrt(after.moment2 / (1 - std::pow(beta2, s))) + epsilon);
  return after;
}

double opacity_penalty(double raw, double weight, std::size_t count) {
  return weight / static_cast<double>(count) * sigmoid(raw) * (1 - sigmoid(raw));
}

double scale_penalty(double raw, double weight, std::size_t count) {
  return weight / (3.0 * static_cast<double>(count)) * sigmoid(raw);
}

Displacement noise(const SplatModel& model, std::size_t splat, double amount, const Draw& draw) {
  const Rows rows(model.dim, model.variant);
  const std::vector<double> raw = raw_of(model, splat);
  const Matrix<double> factor = covariance_factor<double>(raw, rows, model.variant);
  const double opacity = sigmoid(raw[static_cast<std::size_t>(rows.opacity)]);
  const double open = std::pow(1 - opacity, 100);
  const std::array<double, 3> e = normals(draw);
  Displacement result;
  for (int r = 0; r < 3; ++r)
    for (int k = 0; k < rows.dim; ++k) {
      double projected = 0, size = 0;
      for (int c = 0; c < 3; ++c) {
        projected += factor(c, k) * e[static_cast<std::size_t>(c)];
        size += std::abs(factor(c, k));
      }
      const auto at = static_cast<std::size_t>(r);
      result.displacement[at] += open * amount * factor(r, k) * projected;
      result.size[at] += open * amount * std::abs(factor(r, k)) * size;
    }
  return result;
}

std::vector<double> split(const SplatModel& model, std::size_t splat, int copies, double spread) {
  const Rows rows(model.dim, model.variant);
  std::vector<double> raw = raw_of(model, splat);
  const double opacity =
      std::clamp(1 - std::pow(1 - sigmoid(raw[static_cast<std::size_t>(rows.opacity)]), 1.0 / (copies + 1)),
                 0.005, 1 - 0x1p-23);
  raw[static_cast<std::size_t>(rows.opacity)] = std::log(opacity / (1 - opacity));
  if (spread == 0) return raw;
  const double shrink = 1 / std::hypot(1, spread);
  for (int c = 0; c < 3; ++c) {
    double& scale = raw[static_cast<std::size_t>(rows.scale + c)];
    scale = std::log(std::expm1(shrink * softplus(scale)));
  }
  const bool skew = model.variant.cov_param == CovParam::skew_nd;
  for (int r = 0; r < rows.dim; ++r)
    for (int c = 0; c < std::min(r, 3); ++c) {
      double& entry = raw[static_cast<std::size_t>(rows.triangle + r * (r - 1) / 2 + c)];
      if (r < 3 && model.variant.cov_param == CovParam::cholesky) entry *= shrink;
      if (r >= 3 && !skew) entry /= shrink;
    }
  return raw;
}

Displacement place(const std::vector<double>& raw, int dim, const ModelVariant& variant, double spread,
                   const Draw& draw) {
  const Matrix<double> factor = covariance_factor<double>(raw, Rows(dim, variant), variant);
  const std::array<double, 3> e = normals(draw);
  Displacement result;
  for (int r = 0; r < 3; ++r)
    for (int k = 0; k < 3; ++k) {
      const double term = spread * factor(r, k) * e[static_cast<std::size_t>(k)];
      result.displacement[static_cast<std::size_t>(r)] += term;
      result.size[static_cast<std::size_t>(r)] += std::abs(spread * factor(r, k));
    }
  return result;
}

}  // namespace ubs::oracle
