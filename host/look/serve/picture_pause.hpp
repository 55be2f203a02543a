// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/base/time_source.hpp"

namespace ubs::serve {

// PicturePause limits the rendering of images during training to a share of the time: after an image that
// took t seconds, no image is rendered for t (1 - share) / share seconds. The pause is proportional to the
// cost of the last image, so a cheap image of one viewer delays the others only briefly, and unused time does
// not accumulate.
class PicturePause {
 public:
  PicturePause(double share, const TimeSource& time) : share_(share), time_(&time) {}
  bool over() const { return time_->seconds() >= end_; }
  void begin(double cost) { end_ = time_->seconds() + period(cost) - cost; }
  double period(double cost) const { return cost / share_; }  // duration of the image and its pause

 private:
  double share_;
  const TimeSource* time_;
  double end_ = 0;
};

}  // namespace ubs::serve
