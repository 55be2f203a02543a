// SPDX-License-Identifier: Apache-2.0
// A training that fits a time (docs/budget.md): from a short measurement on the device follows a schedule,
// complete before the first step, as plain settings.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "host/device/device.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/splat_model.hpp"
#include "host/spec/train_settings.hpp"
#include "host/train/plan.hpp"

namespace ubs {

// "90", "90s", "10m", "1.5h" in seconds; throws Error(usage) for anything else.
double budget_seconds(const std::string& text);

// What schedules far below the published 30 000 iterations start from: faster rates, directions that begin
// wide, coarse images first. data_specs/fast.yaml holds the same.
TrainSettings short_run_settings();

// What the training pictures say about a schedule.
struct PictureFacts {
  std::size_t random_points = SIZE_MAX;              // more splats than that are not drawn at random
  bool lone_object = false;                          // nothing is to be seen behind what they show
  std::optional<std::array<double, 3>> mean_colour;  // of photographs, on which a background has no part
  bool few_photographs = false;                      // which are soon learnt by heart
};

// The schedule of a run of so many iterations that starts with `initial` splats: most splats, refinement and
// growth. Settings that differ from those of short_run_settings(), or that TrainSettings::chosen names, are
// somebody's choice and stay.
TrainSettings short_schedule(const TrainSettings& settings, int iterations, std::size_t initial,
                             const PictureFacts& pictures = {});
// As many splats as such a run ends with, unless cap_max says otherwise; `points`: as in fit_budget().
int short_run_splats(int iterations, std::size_t points);

// Seconds of such runs over those expected: a little more than observed (docs/results/2026-11-22-plan.md);
// and over the budget where TimedEnd fits their end to it.
inline constexpr double kBudgetLeast = 0.8, kBudgetMost = 1.2, kEndLeast = 0.95, kEndMost = 1.05;

// A step on each level with few and with more splats, as they are after a pilot run.
struct StepCosts {
  std::vector<PlanLevel> levels;  // `until` of a run of 30 000 iterations
  std::uint32_t few = 0, more = 0;
  double over_pilot = 1;  // seconds of runs over those that these steps would take
  double spent = 0;       // seconds that the measurement took
};
StepCosts measure_steps(Device& device, const TrainSettings& settings, const Split& train,
                        const SplatModel& initial, bool from_points, double budget);

// Expected seconds of a run with these settings, which starts with `initial` splats; after `iterations`.
double expected_seconds(const StepCosts& costs, const TrainSettings& settings, const Split& train,
                        std::size_t initial, int iterations);

// The longest short_schedule() whose expected seconds do not exceed the budget; `points`: splats that the
// data could start with, 0 where they are drawn at random. Throws Error(usage) where even the shortest one
// does not fit.
struct BudgetRun {
  TrainSettings settings;
  double seconds = 0;
  std::vector<double> curve;  // expected seconds after each percent of the iterations
  bool longest = false;       // more time would change nothing
};
// `aim`: the share of the budget that is planned.
BudgetRun fit_budget(const StepCosts& costs, const TrainSettings& settings, const Split& train,
                     std::size_t points, double budget, const PictureFacts& pictures = {}, double aim = 1);

// Share of a budget that is planned where TimedEnd fits the end: that is stretched further than it shrinks,
// and what moves takes longer than its rehearsal says (docs/results/2026-11-24-budgets.md).
inline constexpr double kAim = 0.9, kAimMoving = 0.8;

// The schedule that was found for `base`, in few iterations and mostly on small images, from the same first
// splats to as many at its end.
TrainSettings rehearsal(const BudgetRun& run, const TrainSettings& base, std::size_t points, double budget);

// Runs it: what it takes over what its steps would becomes costs.over_pilot. For fit_budget() again.
void rehearse_budget(Device& device, const TrainSettings& settings, const Split& train,
                     const SplatModel& initial, StepCosts& costs);

// Nobody asked for a schedule: it is one of kUnaskedIterations, which come to what the published ones come to
// (docs/results/2026-11-22-long-schedules.md), or where they take longer than kLongestUnasked one of
// kUnaskedBudget.
inline constexpr int kUnaskedIterations = 16000;
inline constexpr double kLongestUnasked = 3600, kUnaskedBudget = 900;

}  // namespace ubs
