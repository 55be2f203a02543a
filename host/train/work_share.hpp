// SPDX-License-Identifier: Apache-2.0
// WorkShare computes the share of the work of a training that is done after an iteration, from 0 to 1. Every
// decision of a schedule is a function of this share. In a run of N iterations, the share after iteration i
// is i/N. A run with a time budget passes through the points (iteration, share) of the setting work_shares,
// which are set during the run (host/train/time_budget.hpp). The share is linear between the points, and from
// the last point to (iterations, 1). A run may leave its way to a point early, if it is given another time:
// such a point is recorded with the iteration after which the run left, so that the shares up to there stay
// the same bits. After a point of share 1, the share may fall: a finished run was continued, and repeats the
// last part of its work.
#pragma once

#include <vector>

#include "host/scene/train_settings.hpp"

namespace ubs {

class WorkShare {
 public:
  explicit WorkShare(const TrainSettings& settings);

  // Returns the share of the work that is done after the iteration.
  double at(int iteration) const;
  // Schedules count in steps. If the share is proportional to the iterations, steps are the iterations of the
  // run; otherwise the run has kScheduleLength steps. steps() returns their total number, and steps_at() the
  // number that is done after the iteration.
  int steps() const { return pieces_.size() == 1 ? iterations_ : kScheduleLength; }
  double steps_at(int iteration) const;
  // Returns the iteration that is nearest to this number of steps. For iterations up to the last point, the
  // result does not change when points are added later. If the run passes this number of steps twice, because
  // it was continued after its end, the result is the first iteration.
  int iteration_at(double steps) const;
  // Returns how many iterations the whole work would take at the speed of this iteration.
  double iterations_per_share(int iteration) const;
  // Returns the last point, or where the run left its way to it; (0, 0) if there is none.
  SharePoint last() const { return pieces_.back().from; }

 private:
  // The share is on the line from `from` to `to`, up to `end`, where the next piece begins.
  struct Piece {
    SharePoint from, to, end;
    int iteration_at(double share) const;
  };
  const Piece& piece_of(int iteration) const;

  std::vector<Piece> pieces_;  // the last one ends at the end of the run
  std::vector<Piece> left_;    // those that end before their point
  int iterations_;
};

}  // namespace ubs
