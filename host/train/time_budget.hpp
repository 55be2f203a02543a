// SPDX-License-Identifier: Apache-2.0
// BudgetPace adapts the length of a training to a time budget (docs/budget.md). A run with a time budget
// proceeds through its work as fast as the clock allows: at closely spaced points it compares the remaining
// time with the remaining work, and sets the number of iterations for the rest of the work. Each point
// becomes part of the settings, so that the run can be repeated without a clock.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "host/scene/dataset.hpp"
#include "host/train/fast_settings.hpp"
#include "host/train/pyramid.hpp"
#include "host/train/schedule.hpp"

namespace ubs {

// Converts "90", "90s", "10m", "2 min", "1.5h" or "1h30m" into seconds. Throws Error(usage) for any other
// text.
double time_budget_seconds(const std::string& text);

// Time of a step on training images that are reduced by `factor`: fixed_ms + each_ms for every splat.
// sweep_ms is the time of one sweep over all cameras on these images, if cameras are refined.
struct StepCost {
  int factor = 1;
  double fixed_ms = 0, each_ms = 0, sweep_ms = 0;
  double step_ms(double splats) const;
  bool operator==(const StepCost&) const = default;
};

// WorkTime computes the time that a schedule takes from the costs of its steps.
class WorkTime {
 public:
  // `costs` must contain an entry for each level. Throws Error(internal) if one is missing.
  WorkTime(const std::vector<StepCost>& costs, const Schedule& schedule,
           const std::vector<PyramidLevel>& levels);
  // Returns the seconds that the steps from this share of the work to its end would take if the whole work
  // were a single iteration. The caller multiplies the result by the number of iterations for the whole work.
  double steps_left(double share) const;
  // Returns the time of the camera sweeps after this share, in seconds.
  double sweeps_left(double share) const;

 private:
  std::vector<double> left_;  // samples at equal distances from share 0 to 1
  struct Sweep {
    double share = 0, seconds = 0;
  };
  std::vector<Sweep> sweeps_;
};

// Returns work_shares up to this iteration, after which the run leaves the way to its next point. A run that
// continues there with another time budget sets a new pace for the rest.
std::string shares_until(const TrainSettings& settings, int iteration);

// The last part of the schedule: full-size images, no refinement, and learning rates that fall to 0. A run
// that is to end early goes on here (BudgetPace::complete), instead of doing all of the rest in a short time:
// after a quarter of a run of 2000 iterations (colmap_cup_800, --downscale 4), 50 iterations of the last part
// gave 29.10 dB, and 50 iterations for all of the rest gave 28.29 dB.
inline constexpr double kLastPart = 0.85;
// Returns the seconds for the last part of a run that is to end early: a tenth of the training time so far,
// at least 5 s and at most 60 s, but not more than the time that is left.
double cooldown_seconds(double trained, double left);

struct TimeBudget {
  double seconds = 0;  // 0: the run has no budget
  double spent = 0;    // part of it that passed before the first iteration
  int most_iterations = kScheduleLength;
  int first_iterations = 0;  // number of iterations that the settings were chosen for
  std::vector<StepCost> costs;
  bool operator==(const TimeBudget&) const = default;
};

inline constexpr int kMinIterations = 100;  // fewer iterations give no usable model

// Returns the estimated seconds of a run of `iterations` iterations with the measured costs. The other
// arguments are those of choose_iterations().
double expected_seconds(int iterations, const std::vector<StepCost>& costs, const TrainSettings& base,
                        const Split& train, std::size_t points, const PictureFacts& pictures = {});

// Chooses the number of iterations that fits into a time budget, as far as this can be known before the first
// iteration, and returns the settings for it. The function also sets first_iterations of the returned budget.
// `points` is the number of splats that the data can provide at the start; 0: they are placed at random.
// Throws Error(usage) if the whole time is too short for kMinIterations. If only the time that is left is too
// short, prints a warning and extends the budget.
struct BudgetedRun {
  TrainSettings settings;
  TimeBudget budget;
};
BudgetedRun choose_iterations(TimeBudget budget, const TrainSettings& base, const Split& train,
                              std::size_t points, const PictureFacts& pictures = {});

// BudgetPace keeps a run within its time budget.
class BudgetPace {
 public:
  BudgetPace(TimeBudget budget, const TrainSettings& settings, const Split& train, std::size_t initial);

  // Must be called when the run starts or continues after this iteration. `seconds` is the training time so
  // far, and `swept` the part of it that was spent on camera sweeps.
  void begin(const WorkShare& work, int iteration, double seconds, double swept);
  // Adds the next point to `settings`, and sets their number of iterations to the number that now fits into
  // the budget. Must be called before the first iteration, and after the iteration of the last point. The
  // speed changes by half at most, unless the budget is new (`any_change`).
  void advance(TrainSettings& settings, int iteration, double seconds, double swept, bool any_change = false);
  // Completes the schedule in about `within` seconds: the work between now and kLastPart is left out, and the
  // pace for the rest follows from the time. After the last iteration, the work from kLastPart on is done
  // again. Called instead of advance(). `splats` is the present number of splats.
  void complete(TrainSettings& settings, int iteration, double seconds, double swept, double within,
                std::uint32_t splats);
  // Returns the present estimate of the training time after this iteration, in seconds.
  double seconds_left(const WorkShare& work, int iteration) const;
  // Returns whether a run with the present number of iterations can have more than `splats` splats.
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
  double slowness_ = 1;                     // actual / expected seconds of the recent steps
  double swept_ = 0, sweeps_expected_ = 0;  // seconds
};

}  // namespace ubs
