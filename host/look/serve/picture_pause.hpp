// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/base/time_source.hpp"

namespace ubs::serve {

// PicturePause keeps the pictures of a training within a share of the time: after a picture that took t
// seconds, none is drawn for t (1 - share) / share seconds. So nobody waits longer for a small picture of
// somebody else than it cost, and nothing is saved up.
class PicturePause {
 public:
  PicturePause(double share, const TimeSource& time) : share_(share), time_(&time) {}
  bool over() const { return time_->seconds() >= end_; }
  void begin(double cost) { end_ = time_->seconds() + period(cost) - cost; }
  double period(double cost) const { return cost / share_; }  // of the picture and its pause

 private:
  double share_;
  const TimeSource* time_;
  double end_ = 0;
};

}  // namespace ubs::serve
