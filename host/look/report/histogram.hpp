// SPDX-License-Identifier: Apache-2.0
// These functions make histograms of many values with unknown spread. The bins are linear or logarithmic and
// cover most of the values. Values outside of the bins are counted separately.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace ubs {

struct Bins {
  std::vector<double> edges;  // in ascending order; there is one more edge than bins
};

struct Histogram {
  std::vector<double> share;         // share of all finite values, one per bin
  std::size_t values = 0;            // number of finite values
  std::size_t below = 0, above = 0;  // number of finite values below the first bin and above the last bin
  double minimum = 0, median = 0, maximum = 0;  // of the finite values; 0 if there are none
};

// Returns `count` bins that cover the finite values from the quantile `outside` to the quantile 1 -
// `outside`. If `logarithmic` is true, only positive values count, and the edges of the bins form a geometric
// sequence. If all values are almost equal, the range is widened. If there are no values, the range is [0,
// 1], or [0.1, 1] if it is logarithmic.
Bins make_bins(std::vector<double> values, std::size_t count, bool logarithmic, double outside);
// Returns `count` linear bins from `low` to `high`.
Bins make_bins(double low, double high, std::size_t count);

// Counts the values in each bin. A bin includes its lower edge and excludes its upper edge; the last bin
// includes both. Values outside of the bins, including those that a logarithmic axis cannot show, count as
// below or above.
Histogram make_histogram(std::span<const double> values, const Bins& bins);

}  // namespace ubs
