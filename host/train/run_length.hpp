// SPDX-License-Identifier: Apache-2.0
// RunLength changes the number of iterations of a run while it runs, so that the run keeps within a time
// budget or ends early (docs/budget.md). It applies the decisions of BudgetPace to the schedule of the run.
#pragma once

#include <optional>

#include "host/train/time_budget.hpp"
#include "host/train/trained_scene.hpp"

namespace ubs {

class RunLength {
 public:
  // The scene and the progress of the run must outlive the object. `initial` is the number of splats at the
  // start of the run.
  RunLength(TrainedScene& scene, TrainProgress& progress, std::uint32_t initial)
      : scene_(scene), progress_(progress), initial_(initial) {}

  // See Trainer::keep_to().
  void keep_to(const TimeBudget& budget);
  // Changes the schedule so that the run ends in about `seconds` seconds (BudgetPace::complete).
  void complete(double seconds);

  // Returns whether the length of the run is adapted. If it is not, the methods below do nothing.
  bool adapts() const { return pace_.has_value(); }
  bool change_is_due() const;  // returns whether set() must be called now, after the device has finished
  void set(bool any_change = false);  // see BudgetPace::advance()
  // Stops the growth of the number of splats if there is no time to train more of them.
  void limit_growth();
  // Must be called after the state of the run was replaced.
  void restart();
  // Returns the estimated training time that is left, in seconds; 0 if the length is not adapted.
  double seconds_left() const;

 private:
  void begin(TimeBudget budget);
  double swept() const { return scene_.cameras().swept_seconds(); }

  TrainedScene& scene_;
  TrainProgress& progress_;
  const std::uint32_t initial_;
  std::optional<BudgetPace> pace_;
};

}  // namespace ubs
