// SPDX-License-Identifier: Apache-2.0
// WorkShare computes the share of the work of a training run that is done after an iteration, from 0 to 1.
// Every decision of a schedule is a function of this share. In a run of N iterations, the share after
// iteration i is i/N. In a run with a time budget, the setting work_shares contains points (iteration,
// share), which are added during the run (host/train/time_budget.hpp). The share is linear between these
// points, and from the last point to (iterations, 1). If the remaining time of a run changes, the run may
// change its pace before it reaches its next point, or its end if it has no points. The point that was not
// reached is then stored together with the iteration after which the pace changed, so that the shares up to
// this iteration remain bit-identical. After a point with the share 1, the share may decrease. This happens
// if a finished run is continued, because it repeats the last part of its work.
#pragma once

#include <vector>

#include "host/settings/train_settings.hpp"

namespace ubs {

class WorkShare {
 public:
  explicit WorkShare(const TrainSettings& settings);

  // Returns the share of the work that is done after the iteration.
  double at(int iteration) const;
  // Schedules use steps as a unit of the work. If the number of iterations was chosen when the run started, a
  // step is an iteration of this run, even if the run later received another time budget. Otherwise the whole
  // work has kScheduleLength steps. steps() returns the number of steps of the whole work, and steps_at() the
  // number of steps that are done after an iteration.
  int steps() const { return steps_; }
  double steps_at(int iteration) const;
  // Returns the iteration that is nearest to this number of steps. For iterations up to the last point, the
  // result does not change when points are added later. If the run reaches this number of steps twice,
  // because it was continued after its end, the result is the first of the two iterations.
  int iteration_at(double steps) const;
  // Returns the number of iterations that the whole work would take at the pace of this iteration.
  double iterations_per_share(int iteration) const;
  // Returns the last point. If the run changed its pace before this point, returns the iteration and the
  // share at which the pace changed. Returns (0, 0) if there are no points.
  SharePoint last() const { return pieces_.back().from; }

 private:
  // In a piece, the share is on the line from the point `from` to the point `to`. The piece ends at `end`,
  // where the next piece begins.
  struct Piece {
    SharePoint from, to, end;
    int iteration_at(double share) const;
  };
  const Piece& piece_of(int iteration) const;

  std::vector<Piece> pieces_;  // the last one ends at the end of the run
  std::vector<Piece> left_;    // the pieces that end before their point `to`
  int steps_ = kScheduleLength;
  int counted_ = 0;  // last iteration up to which each iteration is exactly one step
};

}  // namespace ubs
