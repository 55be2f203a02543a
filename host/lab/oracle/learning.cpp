// SPDX-License-Identifier: Apache-2.0
#include "host/lab/oracle/learning.hpp"

#include <cmath>
#include <numbers>
#include <vector>

#include "host/base/philox.hpp"
#include "host/lab/oracle/splat_formula.hpp"

namespace ubs::oracle {
namespace {

// Returns three standard normal random numbers for a splat and an iteration. The Box-Muller method computes
// them from the four random words of a Philox counter.
std::array<double, 3> normals(std::uint32_t item, std::uint64_t seed, std::uint64_t iteration) {
  constexpr std::uint32_t kNoise = 0x55000003u;  // identifies the purpose of the random numbers
  const PhiloxCounter words = philox4x32_10(
      {item, static_cast<std::uint32_t>(iteration), static_cast<std::uint32_t>(iteration >> 32), kNoise},
      {static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32)});
  const auto unit = [&](std::size_t k) { return (words[k] + 0.5) * 0x1p-32; };
  const double r0 = std::sqrt(-2 * std::log(unit(0))), r1 = std::sqrt(-2 * std::log(unit(2)));
  const double turn = 2 * std::numbers::pi;
  return {r0 * std::cos(turn * unit(1)), r0 * std::sin(turn * unit(1)), r1 * std::cos(turn * unit(3))};
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

Noise noise(const SplatModel& model, std::size_t splat, double amount, std::uint64_t seed,
            std::uint64_t iteration) {
  const Rows rows(model.dim, model.variant);
  std::vector<double> raw;
  for (int r = 0; r < rows.count; ++r) raw.push_back(model.row(r)[splat]);
  const Matrix<double> factor = covariance_factor<double>(raw, rows, model.variant);
  const double opacity = sigmoid(raw[static_cast<std::size_t>(rows.opacity)]);
  const double open = std::pow(1 - opacity, 100);
  const std::array<double, 3> e = normals(static_cast<std::uint32_t>(splat), seed, iteration);
  Noise result;
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

}  // namespace ubs::oracle
