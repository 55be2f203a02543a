// SPDX-License-Identifier: Apache-2.0
#include "host/train/run_length.hpp"

#include <utility>

namespace ubs {

void RunLength::keep_to(const TimeBudget& budget) {
  const bool begins = progress_.iteration == 0 && scene_.settings().work_shares.empty();
  if (begins) progress_.seconds = budget.spent;
  begin(budget);
  // A run that is resumed with another budget starts at the last point, so it needs a new one. In other
  // resumed runs, the last point is after the current iteration, because states are saved after the next
  // point has been set.
  if (begins || change_is_due()) set(true);
}

void RunLength::complete(double seconds) {
  if (!pace_) begin({});
  TrainSettings changed = scene_.settings();
  pace_->complete(changed, progress_.iteration, progress_.seconds, swept(), seconds, scene_.splats());
  scene_.set_schedule(std::move(changed));
}

void RunLength::begin(TimeBudget budget) {
  const Split& train = scene_.views().train();
  TrainedCameras& cameras = scene_.cameras();
  if (budget.costs.empty()) {
    use_speed(budget, scene_.settings(), train, progress_, swept());
    if (cameras.refines())
      for (StepCost& cost : budget.costs) cost.sweep_ms = 1e3 * cameras.sweep_seconds(cost.factor);
  }
  pace_.emplace(std::move(budget), scene_.settings(), train, initial_);
  restart();
}

bool RunLength::change_is_due() const {
  return pace_ && progress_.iteration == scene_.schedule().work().last().iteration &&
         progress_.iteration < scene_.settings().iterations;
}

void RunLength::set(bool any_change) {
  if (!pace_) return;
  TrainSettings changed = scene_.settings();
  pace_->advance(changed, progress_.iteration, progress_.seconds, swept(), any_change);
  scene_.set_schedule(std::move(changed));
}

void RunLength::limit_growth() {
  const TrainSettings& now = scene_.settings();
  if (!pace_ || now.growth_end != 1 || pace_->serves_more(scene_.splats(), now)) return;
  TrainSettings changed = now;
  changed.growth_end = scene_.schedule().work().at(progress_.iteration);
  scene_.set_schedule(std::move(changed));
}

void RunLength::restart() {
  if (pace_) pace_->begin(scene_.schedule().work(), progress_.iteration, progress_.seconds, swept());
}

double RunLength::seconds_left() const {
  return pace_ ? pace_->seconds_left(scene_.schedule().work(), progress_.iteration) : 0;
}

}  // namespace ubs
