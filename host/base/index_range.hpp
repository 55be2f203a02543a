// SPDX-License-Identifier: Apache-2.0
// IndexRange is a range of indices: `first`, then every `step`-th one before `end`.
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

// Returns the text of a range as it is written in settings: "0:300:2", "10" for all from 10 on, or "" for all
// indices.
inline std::string to_string(const IndexRange& range) {
  if (range == IndexRange{}) return "";
  if (range.end == INT_MAX && range.step == 1) return fmt::format("{}", range.first);
  return fmt::format("{}:{}:{}", range.first, range.end, range.step);
}

}  // namespace ubs
