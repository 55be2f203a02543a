// SPDX-License-Identifier: Apache-2.0
// BudgetPace adapts the length of a training run to a time budget (docs/budget.md). At closely spaced points
// of the run, it compares the remaining time with the remaining work, and sets the number of iterations for
// the rest of the work. Each point becomes part of the settings, so that the run can be repeated without a
// clock.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "host/scene/dataset.hpp"
#include "host/settings/schedule.hpp"
#include "host/settings/settle.hpp"
#include "host/train/pyramid.hpp"
#include "host/train/train_state.hpp"

namespace ubs {

// StepCost holds the times of training with images that are reduced by `factor`. A step takes fixed_ms plus
// each_ms for every splat, but at least a tenth of fixed_ms. If cameras are refined, a sweep over all cameras
// takes sweep_ms.
struct StepCost {
  int factor = 1;
  double fixed_ms = 0, each_ms = 0, sweep_ms = 0;
  double step_ms(double splats) const;  // returns the time of a step with this number of splats
  bool operator==(const StepCost&) const = default;
};

// WorkTime computes the time that a schedule takes from the costs of its steps.
class WorkTime {
 public:
  // `costs` must contain an entry for each level of the image pyramid. Throws Error(internal) if one is
  // missing.
  WorkTime(const std::vector<StepCost>& costs, const Schedule& schedule,
           const std::vector<PyramidLevel>& levels);
  // Returns the seconds that the steps from this share of the work to its end would take if the whole work
  // were a single iteration. The caller multiplies the result by the number of iterations for the whole work.
  double steps_left(double share) const;
  // Returns the time of the camera sweeps after this share, in seconds.
  double sweeps_left(double share) const;

 private:
  std::vector<double> left_;  // steps_left() at evenly spaced shares from 0 to 1
  struct Sweep {
    double share = 0, seconds = 0;
  };
  std::vector<Sweep> sweeps_;
};

// Returns the setting work_shares of a run that changes its pace after this iteration. The result contains
// the points up to this iteration, and the next point with a mark that the run changes its pace before it. It
// is used when a run is continued with another time budget.
std::string shares_until(const TrainSettings& settings, int iteration);

// The share of the work at which the last part of the schedule begins. With the settings that
// the schedule fast chooses, this part has no refinement, and its learning rates decrease to 0. It uses
// full-size images, except in runs with the image pyramids for large images or for few uses of each image,
// which can use reduced images up to a share of 0.95. A run that must end early skips to this part
// (BudgetPace::complete), because this is better than going through the whole remaining schedule in a short
// time. This was measured after a quarter of a run of 2000 iterations (colmap_cup_800, --downscale 4): 50
// iterations of the last part gave 29.10 dB, and 50 iterations for the whole remaining schedule gave 28.29
// dB.
inline constexpr double kLastPart = 0.85;
// Returns the seconds for the last part of a run that must end early. This is a tenth of the training time so
// far, `trained`, but at least 5 s and at most 60 s, and not more than `left`, the time that is left.
double cooldown_seconds(double trained, double left);

// TimeBudget is the time budget of a run, with the data that are needed to keep it.
struct TimeBudget {
  double seconds = 0;                     // 0: the run has no budget
  double spent = 0;                       // seconds of the budget that passed before the first iteration
  int most_iterations = kScheduleLength;  // maximum number of iterations
  int first_iterations = 0;               // number of iterations that the settings were chosen for
  std::vector<StepCost> costs;
  bool operator==(const TimeBudget&) const = default;
};

// Completes the budget of a run whose steps were not measured before it started. The costs of the steps are
// estimated from the iterations so far, `swept` seconds of which were spent on camera sweeps. The time of a
// step is assumed to be proportional to its number of pixels; BudgetPace corrects it during the run. The
// costs of sweeps are not set.
void use_speed(TimeBudget& budget, const TrainSettings& settings, const Split& train,
               const TrainProgress& progress, double swept);

// Minimum number of iterations of a run with a time budget. Fewer iterations give no usable model.
inline constexpr int kMinIterations = 100;

// Returns the estimated seconds of a run of `iterations` iterations of the training views, with the measured
// costs.
double expected_seconds(int iterations, const std::vector<StepCost>& costs, const TrainSettings& asked,
                        const Facts& facts, const Split& train);

// Returns the settings asked for, with this number of iterations instead of a budget.
TrainSettings with_iterations(TrainSettings asked, const Facts& facts, int iterations);
// choose_iterations() chooses the number of iterations that is expected to fit into a time budget, and
// settles the settings for it. It also sets first_iterations of the returned budget. Throws Error(usage) if
// the whole budget is too short for kMinIterations. If only the time that is left of the budget is too short,
// prints a warning and extends the budget.
struct BudgetedRun {
  Settled settled;
  TimeBudget budget;
};
BudgetedRun choose_iterations(TimeBudget budget, const TrainSettings& asked, const Facts& facts,
                              const Split& train);

// BudgetPace keeps a run within its time budget.
class BudgetPace {
 public:
  BudgetPace(TimeBudget budget, const TrainSettings& settings, const Split& train, std::size_t initial);

  // Must be called when the run starts, or when it continues after `iteration`. `seconds` is the training
  // time so far, and `swept` the part of it that was spent on camera sweeps.
  void begin(const WorkShare& work, int iteration, double seconds, double swept);
  // Adds the next point to settings.work_shares, and sets settings.iterations to the number that now fits
  // into the budget. Must be called before the first iteration, and then after the iteration of the last
  // point. The number of iterations for the whole work changes by at most 50 % per call. With `any_change`,
  // which is used for a new budget, it may change by any factor. A new budget that is too short for the
  // camera sweeps is then extended, with a warning.
  void advance(TrainSettings& settings, int iteration, double seconds, double swept, bool any_change = false);
  // Changes the settings so that the run ends in about `within` seconds. Must be called instead of advance().
  // The work between now and kLastPart is skipped, and the number of iterations for the rest is chosen by the
  // time. If the run has already finished, it repeats the work from kLastPart on. `splats` is the current
  // number of splats.
  void complete(TrainSettings& settings, int iteration, double seconds, double swept, double within,
                std::uint32_t splats);
  // Returns the current estimate of the remaining training time after this iteration, in seconds.
  double seconds_left(const WorkShare& work, int iteration) const;
  // Returns whether a run with settings.iterations iterations can train more than `splats` splats.
  bool serves_more(std::uint32_t splats, const TrainSettings& settings) const;

 private:
  void measure(const WorkShare& work, int iteration, double seconds, double swept);
  double slowness_of_rest(double share) const;
  double sweeps_left(double share) const;
  double iterations_per_share(const WorkShare& work, int iteration, double seconds, bool any_change) const;

  TimeBudget budget_;
  WorkTime time_;
  struct {
    int iteration = 0;
    double share = 0, seconds = 0, swept = 0;
  } since_;                                 // start of the measurement in progress
  double slowness_ = 1;                     // actual time of recent steps relative to the expected time
  double swept_ = 0, sweeps_expected_ = 0;  // actual and expected time of the sweeps so far [s]
};

}  // namespace ubs
