// SPDX-License-Identifier: Apache-2.0
// SimulatedTime is a clock whose time only changes when the test advances it.
#pragma once

#include "host/base/time_source.hpp"

namespace ubs::test {

class SimulatedTime final : public TimeSource {
 public:
  double seconds() const override { return now_; }
  void advance(double seconds) { now_ += seconds; }

 private:
  double now_ = 1e6;  // as on a machine that has been running for days
};

}  // namespace ubs::test
