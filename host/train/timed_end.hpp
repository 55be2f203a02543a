// SPDX-License-Identifier: Apache-2.0
// The end of a training that fits a time: the last 15 % of the schedule take the iterations that there is
// time for (docs/budget.md).
#pragma once

#include <optional>

#include "host/scene/dataset.hpp"
#include "host/spec/train_settings.hpp"
#include "host/train/trainer.hpp"

namespace ubs {

class TimedEnd {
 public:
  // `seconds`: of training, from its first iteration on.
  TimedEnd(double seconds, const TrainSettings& settings, const Split& train);

  // Whether images are whole for long enough before that end to be timed.
  static bool can_time(const TrainSettings& settings, const Split& train);

  // To be called after each iteration. Once, where that end begins: the settings for Trainer::end_as(), which
  // repeat the run. Never where they cannot be timed.
  std::optional<TrainSettings> after(const StepReport& report);

 private:
  double seconds_;
  TrainSettings settings_;
  int from_, before_;                // iterations that are timed, after the first to the second one
  int began_at_ = 0, known_at_ = 0;  // the first and the last of these whose time is known
  double began_ = 0, known_ = 0;     // that time
};

}  // namespace ubs
