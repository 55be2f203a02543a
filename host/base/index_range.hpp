// SPDX-License-Identifier: Apache-2.0
// IndexRange is a range of indices. It consists of `first`, `first` + `step`, `first` + 2 `step`, and so on,
// as long as they are below `end`.
#pragma once

#include <fmt/format.h>

#include <climits>
#include <string>

namespace ubs {

struct IndexRange {
  int first = 0, end = INT_MAX, step = 1;

  bool empty() const { return first >= end; }
  bool operator==(const IndexRange&) const = default;
};

// Returns the range as text, in the syntax of settings: "FIRST:END:STEP", for example "0:300:2". The text is
// "10" for all indices from 10 on, and empty for all indices.
inline std::string to_string(const IndexRange& range) {
  if (range == IndexRange{}) return "";
  if (range.end == INT_MAX && range.step == 1) return fmt::format("{}", range.first);
  return fmt::format("{}:{}:{}", range.first, range.end, range.step);
}

}  // namespace ubs
