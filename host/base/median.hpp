// SPDX-License-Identifier: Apache-2.0
// median() computes the median of values in double precision.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace ubs {

// Returns the median. For an even number of values it is the larger of the two middle ones. There must be at
// least one value.
inline double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::ranges::nth_element(values, middle);
  return *middle;
}

}  // namespace ubs
