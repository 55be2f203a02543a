// SPDX-License-Identifier: Apache-2.0
// Histograms of many values of unknown spread: bins over the bulk of the values, linear or logarithmic; what
// lies outside of them is counted, not lost.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace ubs {

struct Bins {
  std::vector<double> edges;  // rising, one more than bins
};

struct Histogram {
  std::vector<double> share;  // of all finite values, one a bin
  std::size_t values = 0;     // finite ones
  std::size_t below = 0, above = 0;
  double minimum = 0, median = 0, maximum = 0;  // of the finite values; 0 without any
};

// `count` bins from the quantile `outside` to the quantile 1 - `outside` of the finite values (logarithmic:
// of the positive ones). A range of no width gets some; without values the range is [0, 1], or [0.1, 1].
Bins make_bins(std::vector<double> values, std::size_t count, bool logarithmic, double outside);
Bins make_bins(double low, double high, std::size_t count);

// Bins are closed below and open above; the last one is closed. Values outside, also those that a logarithmic
// axis cannot show, count as below or above.
Histogram make_histogram(std::span<const double> values, const Bins& bins);

}  // namespace ubs
