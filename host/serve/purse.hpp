// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>

#include "host/base/time_source.hpp"

namespace ubs::serve {

// What pictures may cost: a share of the time that has passed, saved up for ten seconds, or for as long as a
// picture takes that costs more.
class Purse {
 public:
  Purse(double share, const TimeSource& time) : share_(share), time_(&time) {}
  void open() { paid_ = time_->seconds(); }
  bool affords(double cost) const { return time_->seconds() - paid_ >= seconds_for(cost); }
  void spend(double cost) {
    const double oldest = time_->seconds() - std::max(seconds_for(cost), kSaved);
    paid_ = std::max(paid_, oldest) + seconds_for(cost);
  }
  double seconds_for(double cost) const { return cost / share_; }

 private:
  static constexpr double kSaved = 10;
  double share_;
  const TimeSource* time_;
  double paid_ = 0;  // time until then is used up
};

}  // namespace ubs::serve
