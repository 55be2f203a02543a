// SPDX-License-Identifier: Apache-2.0
#include "host/base/statistics.hpp"

#include <algorithm>
#include <cmath>

namespace ubs {
namespace {

double quantile(const std::vector<double>& sorted, double fraction) {
  const double at = fraction * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<std::size_t>(at);
  const std::size_t above = std::min(below + 1, sorted.size() - 1);
  return sorted[below] + (at - static_cast<double>(below)) * (sorted[above] - sorted[below]);
}

}  // namespace

double Summary::uncertainty() const {
  if (samples < 2 || !(median > 0)) return 1;
  return 1.2533 / 1.349 * quartile_spread() / (std::sqrt(static_cast<double>(samples)) * median);
}

Summary summarise(std::span<const double> samples) {
  if (samples.empty()) return {};
  std::vector<double> sorted(samples.begin(), samples.end());
  std::sort(sorted.begin(), sorted.end());
  return {sorted.size(), quantile(sorted, 0.5), sorted.front(), quantile(sorted, 0.25),
          quantile(sorted, 0.75)};
}

bool Sampler::enough() const {
  const double seconds = watch_.seconds();
  if (!values_.empty() && seconds >= limits_.max_seconds) return true;
  return seconds >= limits_.min_seconds && values_.size() >= limits_.min_samples &&
         summary().uncertainty() <= limits_.uncertainty;
}

}  // namespace ubs
