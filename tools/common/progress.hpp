// SPDX-License-Identifier: Apache-2.0
// Progress of a training run on stderr: one line rewritten in place on a terminal, elsewhere one line
// about every ten seconds, nothing when silent.
#pragma once

#include <chrono>

#include "host/train/trainer.hpp"

namespace ubs::tools {

class Progress {
 public:
  Progress(int iterations, bool silent);
  ~Progress() { finish(); }
  Progress(const Progress&) = delete;

  void update(const StepReport& report);
  void finish();  // closes the line

 private:
  using Clock = std::chrono::steady_clock;
  int iterations_;
  bool silent_, terminal_, line_open_ = false;
  Clock::time_point shown_;
  int rate_iteration_ = 0;  // where the rate was last taken
  double rate_seconds_ = 0, rate_ = 0;
};

}  // namespace ubs::tools
