// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>

#include "host/base/stopwatch.hpp"

namespace ubs::serve {

// What pictures may cost: a share of the time that has passed, saved up for ten seconds, or for as long as a
// picture takes that costs more.
class Purse {
 public:
  explicit Purse(double share) : share_(share) {}
  void open() { paid_ = Clock::now(); }
  bool affords(double cost) const { return seconds_since(paid_) >= cost / share_; }
  void spend(double cost) {
    const Clock::time_point oldest = Clock::now() - time_for(std::max(cost, kSaved * share_));
    paid_ = std::max(paid_, oldest) + time_for(cost);
  }
  double seconds_for(double cost) const { return cost / share_; }

 private:
  static constexpr double kSaved = 10;
  Clock::duration time_for(double cost) const {
    return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(cost / share_));
  }
  double share_;
  Clock::time_point paid_;  // time until then is used up
};

}  // namespace ubs::serve
