// SPDX-License-Identifier: Apache-2.0
// Progress on stderr, of a training run or of anything that is counted: one line rewritten in place on a
// terminal, elsewhere one line about every ten seconds of `time`, nothing when silent.
#pragma once

#include <cstddef>
#include <string>

#include "host/base/text.hpp"
#include "host/base/time_source.hpp"
#include "host/train/trainer.hpp"

namespace ubs::tools {

class Progress {
 public:
  Progress(int iterations, bool silent, const TimeSource& time = steady_time());
  ~Progress() { finish(); }
  Progress(const Progress&) = delete;

  void update(const StepReport& report);
  void finish();  // closes the line

 private:
  const TimeSource& time_;
  int iterations_;
  bool silent_, terminal_, line_open_ = false;
  double shown_;            // when [s]
  int rate_iteration_ = 0;  // where the rate was last taken
  double rate_seconds_ = 0, rate_ = 0;
};

// "30/120 frames  12.5 per second  ETA 0:07".
class CountProgress {
 public:
  CountProgress(std::size_t total, std::string what, bool silent = false,
                const TimeSource& time = steady_time());
  ~CountProgress() { finish(); }
  CountProgress(const CountProgress&) = delete;

  void update(std::size_t done);
  void finish();  // closes the line

 private:
  const TimeSource& time_;
  std::size_t total_;
  std::string what_;
  bool silent_, terminal_, line_open_ = false;
  double start_, shown_;  // when [s]
};

}  // namespace ubs::tools
