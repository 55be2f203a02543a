// SPDX-License-Identifier: Apache-2.0
// Training that fits a time (docs/budget.md). A run with a time budget goes through its work as fast as the
// clock allows: at points that follow each other closely it compares the time that is left with the work that
// is left, and sets how many iterations the rest of the work takes. Each point becomes part of the settings,
// so that the run can be repeated without a clock.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "host/scene/dataset.hpp"
#include "host/train/fast_settings.hpp"
#include "host/train/pyramid.hpp"
#include "host/train/schedule.hpp"

namespace ubs {

// Returns "90", "90s", "10m", "2 min", "1.5h", "1h30m" in seconds; throws Error(usage) for anything else.
double time_budget_seconds(const std::string& text);

// What a step takes on training images reduced by `factor`: fixed_ms + each_ms for every splat; and what a
// step of all cameras takes there, where cameras are refined.
struct StepCost {
  int factor = 1;
  double fixed_ms = 0, each_ms = 0, sweep_ms = 0;
  double step_ms(double splats) const;
  bool operator==(const StepCost&) const = default;
};

// The time that a schedule takes, by the costs of its steps.
class WorkTime {
 public:
  // `costs`: one for each level. Throws Error(internal) where one is missing.
  WorkTime(const std::vector<StepCost>& costs, const Schedule& schedule,
           const std::vector<PyramidLevel>& levels);
  // Returns the seconds of the steps from this share of the work to its end, as if all of it were one
  // iteration.
  double steps_left(double share) const;
  // Returns the seconds of the camera sweeps behind this share.
  double sweeps_left(double share) const;

 private:
  std::vector<double> left_;  // at equal distances from share 0 to 1
  struct Sweep {
    double share = 0, seconds = 0;
  };
  std::vector<Sweep> sweeps_;
};

struct TimeBudget {
  double seconds = 0;   // of training; 0: the run has none
  double measured = 0;  // of these, what measuring the costs took
  int most_iterations = kScheduleLength;
  int first_iterations = 0;  // what the settings were chosen for
  std::vector<StepCost> costs;
  bool operator==(const TimeBudget&) const = default;
};

inline constexpr int kMinIterations = 100;  // fewer make no model

// Returns the seconds of a run of so many iterations by the measured costs; the other arguments are those of
// choose_iterations().
double expected_seconds(int iterations, const std::vector<StepCost>& costs, const TrainSettings& base,
                        const Split& train, std::size_t points, const PictureFacts& pictures = {});

// The number of iterations that fits a time budget, as far as it can be known before the first one, and the
// settings for them. `points`: splats that the data could start with, 0 where they are drawn at random.
// `budget`: without first_iterations. Throws Error(usage) where the time is too short for
// kMinIterations.
struct BudgetedRun {
  TrainSettings settings;
  TimeBudget budget;
};
BudgetedRun choose_iterations(TimeBudget budget, const TrainSettings& base, const Split& train,
                              std::size_t points, const PictureFacts& pictures = {});

// Keeps a run to its time budget.
class BudgetPace {
 public:
  BudgetPace(TimeBudget budget, const TrainSettings& settings, const Split& train, std::size_t initial);

  // The run begins, or goes on, after this iteration. Seconds are those of training so far, and of camera
  // sweeps within them.
  void begin(const WorkShare& work, int iteration, double seconds, double swept);
  // To be called after the iteration of the last point, or before the first iteration: adds the next point to
  // `settings` and sets their iterations to what fits the time now.
  void advance(TrainSettings& settings, int iteration, double seconds, double swept);
  // Returns the seconds of training after this iteration, as it looks now.
  double seconds_left(const WorkShare& work, int iteration) const;
  // Whether there is time for more than `splats` splats, in a run that has time for so many iterations now.
  bool serves_more(std::uint32_t splats, const TrainSettings& settings) const;

 private:
  void measure(const WorkShare& work, int iteration, double seconds, double swept);
  double slowness_of_rest(double share) const;
  double sweeps_left(double share) const;
  double iterations_per_share(const WorkShare& work, int iteration, double seconds) const;

  TimeBudget budget_;
  WorkTime time_;
  struct {
    int iteration = 0;
    double share = 0, seconds = 0, swept = 0;
  } since_;                                 // what is measured from there on
  double slowness_ = 1;                     // seconds of steps over those expected, lately
  double swept_ = 0, sweeps_expected_ = 0;  // seconds
};

}  // namespace ubs
