// SPDX-License-Identifier: Apache-2.0
// This file contains functions that measure the error of single-precision results compared with a reference
// in double precision. If any value is not finite, the error is infinite, so that every bound is exceeded.
#pragma once

#include <cmath>
#include <limits>
#include <span>

namespace ubs::test {

// Returns the largest absolute difference.
inline double max_abs_error(std::span<const float> result, std::span<const double> reference) {
  if (result.size() != reference.size()) return std::numeric_limits<double>::infinity();
  double worst = 0;
  for (std::size_t i = 0; i < result.size(); ++i) {
    const double e = std::abs(static_cast<double>(result[i]) - reference[i]);
    if (!(e <= std::numeric_limits<double>::max())) return std::numeric_limits<double>::infinity();
    worst = std::max(worst, e);
  }
  return worst;
}

// Returns |result - reference|_2 / |reference|_2, where 0 / 0 counts as 0.
inline double relative_error(std::span<const float> result, std::span<const double> reference) {
  if (result.size() != reference.size()) return std::numeric_limits<double>::infinity();
  double difference = 0, norm = 0;
  for (std::size_t i = 0; i < result.size(); ++i) {
    const double e = static_cast<double>(result[i]) - reference[i];
    difference += e * e;
    norm += reference[i] * reference[i];
  }
  if (!std::isfinite(difference)) return std::numeric_limits<double>::infinity();
  if (difference == 0) return 0;
  return norm > 0 ? std::sqrt(difference / norm) : std::numeric_limits<double>::infinity();
}

}  // namespace ubs::test
