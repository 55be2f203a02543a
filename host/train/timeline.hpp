// SPDX-License-Identifier: Apache-2.0
// How a run's iterations go through its schedule. One by one, but where lr_cooldown has a stretch: the last
// 15 % of the schedule then take more or fewer of them, as a budget has time left for.
#pragma once

#include "host/spec/train_settings.hpp"

namespace ubs {

class Timeline {
 public:
  explicit Timeline(const TrainSettings& settings);

  // Iterations of the schedule; those of them, and of the run, before what may be stretched.
  int length() const { return length_; }
  int before_end() const { return before_; }
  // Where in the schedule a run's iteration is, 0 to 1; and the iteration that is nearest to a place, which
  // is given in iterations of the schedule.
  double share(int iteration) const;
  int nearest(double scheduled) const;

 private:
  int length_, before_, end_;  // end_: iterations of the run
};

// The settings of a run whose schedule is that of `settings`, but ends at `iterations`. These must be more
// than before_end().
TrainSettings ending_at(const TrainSettings& settings, int iterations);

}  // namespace ubs
