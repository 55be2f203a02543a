// SPDX-License-Identifier: Apache-2.0
// See histogram.hpp.
#include "host/look/report/histogram.hpp"

#include <algorithm>
#include <cmath>

namespace ubs {
namespace {

double nearest_rank(const std::vector<double>& sorted, double quantile) {
  return sorted[static_cast<std::size_t>(std::lround(quantile * static_cast<double>(sorted.size() - 1)))];
}

Bins spaced(double low, double high, std::size_t count, bool logarithmic) {
  Bins bins;
  for (std::size_t i = 0; i <= count; ++i) {
    const double t = static_cast<double>(i) / static_cast<double>(count);
    bins.edges.push_back(logarithmic ? low * std::pow(high / low, t) : low + (high - low) * t);
  }
  bins.edges.back() = high;
  return bins;
}

}  // namespace

Bins make_bins(double low, double high, std::size_t count) { return spaced(low, high, count, false); }

Bins make_bins(std::vector<double> values, std::size_t count, bool logarithmic, double outside) {
  std::erase_if(values, [&](double v) { return !std::isfinite(v) || (logarithmic && v <= 0); });
  if (values.empty()) return spaced(logarithmic ? 0.1 : 0.0, 1.0, count, logarithmic);
  std::sort(values.begin(), values.end());
  double low = nearest_rank(values, outside), high = nearest_rank(values, 1 - outside);
  // If the range is so narrow that rounding errors would show in the bins, widen it so that the axis labels
  // around the single value are readable.
  const double least = 1e-4 * std::max(std::abs(low), std::abs(high));
  if (high - low <= least) {
    const double room = least > 0 ? 500 * least : 0.5;
    low = logarithmic ? low / 1.05 : low - room;
    high = logarithmic ? high * 1.05 : high + room;
  }
  return spaced(low, high, count, logarithmic);
}

Histogram make_histogram(std::span<const double> values, const Bins& bins) {
  Histogram h;
  h.share.assign(bins.edges.size() - 1, 0.0);
  std::vector<double> finite;
  for (const double v : values) {
    if (!std::isfinite(v)) continue;
    finite.push_back(v);
    if (v < bins.edges.front()) {
      ++h.below;
    } else if (v > bins.edges.back()) {
      ++h.above;
    } else {
      const auto edge = std::upper_bound(bins.edges.begin(), bins.edges.end() - 1, v);
      h.share[static_cast<std::size_t>(edge - bins.edges.begin()) - 1] += 1;
    }
  }
  h.values = finite.size();
  if (finite.empty()) return h;
  for (double& s : h.share) s /= static_cast<double>(h.values);
  const auto [low, high] = std::minmax_element(finite.begin(), finite.end());
  h.minimum = *low, h.maximum = *high;
  const auto middle = finite.begin() + static_cast<std::ptrdiff_t>(finite.size() / 2);
  std::nth_element(finite.begin(), middle, finite.end());
  h.median = *middle;
  return h;
}

}  // namespace ubs
