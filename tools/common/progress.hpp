// SPDX-License-Identifier: Apache-2.0
// Progress prints the progress of a training run to stderr, and CountProgress that of other work with a known
// number of steps. On a terminal they rewrite one line; otherwise they print a line about every ten seconds,
// as measured by `time`. Progress also prints a line for each evaluation. If `silent` is set, they print
// nothing.
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
  void finish();  // ends the line

 private:
  const TimeSource& time_;
  int iterations_;
  bool silent_, terminal_, line_open_ = false;
  double shown_;            // time of the last output [s]
  int rate_iteration_ = 0;  // iteration of the last rate measurement
  double rate_seconds_ = 0, rate_ = 0;
};

// Prints lines such as "30/120 frames  12.5 per second  ETA 7.2 s".
class CountProgress {
 public:
  CountProgress(std::size_t total, std::string what, bool silent = false,
                const TimeSource& time = steady_time());
  ~CountProgress() { finish(); }
  CountProgress(const CountProgress&) = delete;

  void update(std::size_t done);
  void finish();  // ends the line

 private:
  const TimeSource& time_;
  std::size_t total_;
  std::string what_;
  bool silent_, terminal_, line_open_ = false;
  double start_, shown_;  // times of the start and of the last output [s]
};

}  // namespace ubs::tools
