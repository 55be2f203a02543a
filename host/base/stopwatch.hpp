// SPDX-License-Identifier: Apache-2.0
// Stopwatch measures the time since its construction or the last restart().
#pragma once

#include "host/base/time_source.hpp"

namespace ubs {

class Stopwatch {
 public:
  // Starts at once. `time` must outlive the stopwatch.
  explicit Stopwatch(const TimeSource& time = steady_time()) : time_(&time), start_(time.seconds()) {}
  void restart() { start_ = time_->seconds(); }
  double seconds() const { return time_->seconds() - start_; }
  double milliseconds() const { return 1e3 * seconds(); }

 private:
  const TimeSource* time_;
  double start_;
};

}  // namespace ubs
