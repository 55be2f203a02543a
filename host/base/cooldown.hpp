// SPDX-License-Identifier: Apache-2.0
// The end of a training: over which share of the schedule all learning rates fall to 0, and whether its last
// iterations are more or fewer than the schedule's (host/train/timeline.hpp).
#pragma once

#include <fmt/format.h>

#include <string>

namespace ubs {

struct Cooldown {
  double share = 0;    // 0 to 1; 0: rates do not fall
  double stretch = 1;  // last iterations over those of the schedule
  bool operator==(const Cooldown&) const = default;
};

// "0.15", or "0.15:1.2" where it is stretched, as settings have it.
inline std::string to_string(const Cooldown& c) {
  return c.stretch == 1 ? fmt::format("{}", c.share) : fmt::format("{}:{}", c.share, c.stretch);
}

}  // namespace ubs
