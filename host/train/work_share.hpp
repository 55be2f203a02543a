// SPDX-License-Identifier: Apache-2.0
// WorkShare tells which share of a training's work is done after an iteration, 0 to 1. Everything that a
// schedule decides is a function of this share. A run of N iterations has done i/N after iteration i. A run
// with a time budget goes through the points (iteration, share) of the setting work_shares, which follow the
// clock (host/train/time_budget.hpp); the share is linear between them, and from the last one to (iterations,
// 1).
#pragma once

#include <vector>

#include "host/scene/train_settings.hpp"

namespace ubs {

class WorkShare {
 public:
  explicit WorkShare(const TrainSettings& settings);

  // Returns the share that is done after the iteration.
  double at(int iteration) const;
  // Schedules count in steps: the iterations of the run where the share is in proportion to them, else
  // kScheduleLength. Returns how many steps there are, and how many are done after the iteration.
  int steps() const { return points_.empty() ? iterations_ : kScheduleLength; }
  double steps_at(int iteration) const;
  // Returns the iteration nearest to this number of steps. Points that are added later do not change it for
  // iterations up to the last point.
  int iteration_at(double steps) const;
  // Returns how many iterations all of the work would take at the speed of this iteration.
  double iterations_per_share(int iteration) const;
  // Returns the last point, (0, 0) where there is none.
  SharePoint last() const { return points_.empty() ? SharePoint{} : points_.back(); }

 private:
  struct Piece {
    SharePoint from, to;
  };
  Piece piece_before(std::size_t point) const;  // the last one ends with the run
  Piece piece_of(int iteration) const;

  std::vector<SharePoint> points_;
  int iterations_;
};

}  // namespace ubs
