// SPDX-License-Identifier: Apache-2.0
#include "host/train/budget.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <string>

#include "host/base/error.hpp"
#include "host/base/stopwatch.hpp"
#include "host/train/run_settings.hpp"
#include "host/train/trainer.hpp"

namespace ubs {
namespace {

constexpr int kMinIterations = 100, kPilotIterations = 100, kMinPilot = 10;
constexpr double kPilotShare = 0.1;   // of the budget
constexpr int kRehearsalViews = 400;  // drawn at least, by at least kMinIterations steps
constexpr const char* kRehearsalPyramid = "4:0.85,2:0.95";
constexpr double kRehearsalShare = 0.08, kRehearsalSeconds = 20;  // at most, of the budget
// Refinements take an Adam step and the moments of what they move: every 100th iteration, as published, not
// every 100th of 30 000 (docs/results/2026-11-21-quality-per-second.md).
constexpr int kRefineEvery = 100, kMinRefinements = 10;
constexpr double kGrownAt = 0.5;  // share of the run after which no splats are added
// Positions that start at random have a way to go, the same in few steps as in many: the published rate times
// 30 000 iterations. Faster ones than kFastest break what is there.
constexpr double kFarTravel = 5, kFastest = 3e-3;
// Points of the data are better splats than those that growth adds.
constexpr int kSplatsAnIteration = 15, kPointsAnIteration = 40, kMinSplats = 10000;
// Seconds of runs over those that the pilot's steps would take: points spread, and random splats shrink where
// they find what they show (docs/results/2026-11-21-without-points.md).
constexpr double kOverPilotPoints = 1.1, kOverPilotRandom = 0.9;

// short_run_settings() is of a run of kShortRun iterations and less. Rates of longer ones, and their shares
// on coarse images, fall as powers of their number (docs/results/2026-11-22-long-schedules.md).
constexpr int kShortRun = 2000;
constexpr double kPyramidPower = 0.5;
constexpr double kMovingCooldown = 0.6;  // of the direct form: docs/results/2026-11-24-budgets.md
constexpr double kFewOpacityReg = 0.02;  // docs/results/2026-11-25-few-photographs.md
constexpr double kDirectionPower = 1.2;  // of beta_dir_init: photographs with points, of what does not move
struct FallingRate {
  const char* key;
  double TrainSettings::*rate;
  double power;
};
constexpr FallingRate kFallingRates[] = {
    {"lr_rgb", &TrainSettings::lr_rgb, 0.35},   {"lr_l_triangle", &TrainSettings::lr_l_triangle, 0.35},
    {"lr_mean", &TrainSettings::lr_mean, 0.35}, {"lr_scale", &TrainSettings::lr_scale, 0.35},
    {"lr_beta", &TrainSettings::lr_beta, 0.6},  {"lr_xyz_final", &TrainSettings::lr_xyz_final, 1.6}};

double fallen(double value, double power, int iterations) {
  return value * std::pow(std::max(1.0, double{1} * iterations / kShortRun), -power);
}

// Whether nobody has chosen the setting `key`, which schedules have at `usual`.
template <typename Value>
bool is_free(const TrainSettings& s, const char* key, const Value& value, const Value& usual) {
  return value == usual && !s.chosen.contains(key);
}

// Few digits, for people who read config.yaml.
void lengthen(TrainSettings& s, int iterations, bool direction_falls) {
  const TrainSettings base = short_run_settings();
  const auto fall = [&](const char* key, double TrainSettings::*value, double power) {
    if (is_free(s, key, s.*value, base.*value))
      s.*value = std::stod(fmt::format("{:.3g}", fallen(base.*value, power, iterations)));
  };
  for (const auto& [key, rate, power] : kFallingRates) fall(key, rate, power);
  if (direction_falls && !has_time(s.dim))
    fall("beta_dir_init", &TrainSettings::beta_dir_init, kDirectionPower);
  if (!is_free(s, "pyramid", s.pyramid, base.pyramid)) return;
  s.pyramid.clear();
  for (const PyramidStep& step : pyramid_steps(base))
    s.pyramid += fmt::format("{}{}:{:.2g}", s.pyramid.empty() ? "" : ",", step.factor,
                             fallen(step.share, kPyramidPower, iterations));
}

int refine_interval(int iterations) { return std::clamp(iterations / kMinRefinements, 1, kRefineEvery); }

std::size_t first_splats(const TrainSettings& s, std::size_t points) {
  return std::min(points > 0 ? points : static_cast<std::size_t>(s.init_points),
                  static_cast<std::size_t>(s.cap_max));
}

}  // namespace

double budget_seconds(const std::string& text) {
  double value = 0;
  const char* const end = text.data() + text.size();
  const auto result = std::from_chars(text.data(), end, value);
  const std::string_view unit(result.ptr, static_cast<std::size_t>(end - result.ptr));
  const double factor = unit.empty() || unit == "s" ? 1 : unit == "m" ? 60 : unit == "h" ? 3600 : 0;
  if (result.ec != std::errc() || factor == 0 || !(value > 0) || value * factor > 1e7)
    fail(ErrorKind::usage, "budget '{}' must be a time such as 90s, 10m or 1.5h", text);
  return value * factor;
}

TrainSettings short_run_settings() {
  TrainSettings s;
  s.lr_cooldown.share = 0.15;
  s.lr_xyz_final = 4e-5;
  s.lr_scale = 0.02;
  s.lr_rgb = 0.005;
  s.lr_l_triangle = 0.005;
  s.lr_beta = 0.01;
  s.lr_mean = 0.005;
  s.beta_dir_init = -3;
  s.pyramid = "4:0.5,2:0.8";
  return s;
}

int short_run_splats(int iterations, std::size_t points) {
  const auto kept = std::min(points, static_cast<std::size_t>(kPointsAnIteration) * iterations);
  return std::max({kMinSplats, kSplatsAnIteration * iterations, static_cast<int>(kept)});
}

TrainSettings short_schedule(const TrainSettings& settings, int iterations, std::size_t points,
                             const PictureFacts& pictures) {
  const TrainSettings standard;
  TrainSettings s = settings;
  s.iterations = iterations;
  if (!s.chosen.contains("lr_cooldown")) s.lr_cooldown.stretch = 1;
  if (is_free(s, "cap_max", s.cap_max, standard.cap_max))
    s.cap_max = std::min(s.cap_max, short_run_splats(iterations, points));
  // Where pictures place points, auto repeats it.
  if (points == 0 && s.init_points == standard.init_points)
    s.init_points =
        static_cast<int>(std::min(static_cast<std::size_t>(s.cap_max / 2), pictures.random_points));
  lengthen(s, iterations, points > 0 && !pictures.lone_object);
  if (has_time(s.dim) && s.variant.direct() &&
      is_free(s, "lr_cooldown", s.lr_cooldown, short_run_settings().lr_cooldown))
    s.lr_cooldown.share = kMovingCooldown;
  if (pictures.mean_colour) s.background.colour = *pictures.mean_colour;
  if (pictures.few_photographs && is_free(s, "opacity_reg", s.opacity_reg, standard.opacity_reg))
    s.opacity_reg = kFewOpacityReg;
  if (points == 0 && is_free(s, "lr_xyz", s.lr_xyz, standard.lr_xyz))
    s.lr_xyz = std::clamp(kFarTravel / iterations, standard.lr_xyz, kFastest);
  const int interval = refine_interval(iterations);
  // refine_every: the step alone, as earlier versions had it.
  if (is_free(s, "refine", s.refine.step, standard.refine.step) && !s.chosen.contains("refine_every"))
    s.refine.step = std::min(
        kScheduleLength, static_cast<int>(std::llround(double{1} * interval * kScheduleLength / iterations)));
  const double first = static_cast<double>(s.refine.first) / kScheduleLength;
  if (first < kGrownAt && !s.refine.empty() && is_free(s, "growth", s.growth, standard.growth)) {
    const double start = static_cast<double>(first_splats(s, points));
    const double events = std::max(1.0, std::floor((kGrownAt - first) * iterations / interval));
    // A short text; and as many steps more as the splats lost to rounding down ask for.
    const double ratio = std::max(1.0, s.cap_max / start);
    double steps = std::ceil(std::pow(ratio, 1 / events) * 1e4);
    const auto grown = [&] {
      s.growth = std::min(steps / 1e4, 10.0);
      return s.growth == 10 ||
             splats_at(s, first_splats(s, points), iterations / 2) >= static_cast<std::uint32_t>(s.cap_max);
    };
    while (!grown()) ++steps;
  }
  return s;
}

StepCosts measure_steps(Device& device, const TrainSettings& settings, const Split& train,
                        const SplatModel& initial, bool from_points, double budget) {
  const auto start = Clock::now();
  const Split none{"test", {}};
  TrainSettings pilot = short_schedule(settings, kPilotIterations, initial.count);
  pilot.cap_max = static_cast<int>(initial.count);
  pilot.on_nan = OnNan::stop;
  pilot.refine_cameras = RefineCameras::none;
  StepCosts costs;
  costs.over_pilot = from_points ? kOverPilotPoints : kOverPilotRandom;
  SplatModel model;
  {
    Trainer trainer(device, pilot, train, none, initial);
    trainer.run([&](const StepReport& report) {
      return report.iteration < kMinPilot || report.seconds < kPilotShare * budget;
    });
    model = trainer.model();
  }
  TrainSettings grown = settings;
  grown.iterations = kScheduleLength;
  grown.growth = 2;
  grown.lr_scale = 0;  // this is the model after a pilot run: the plan needs none of its own
  grown.cap_max = static_cast<int>(2 * model.count);
  const RunPlan plan = plan_training(device, grown, train, none, model, false, false);
  costs.levels = plan.levels;
  costs.few = plan.start.splats;
  costs.more = plan.end.splats;
  costs.spent = seconds_since(start);
  return costs;
}

double expected_seconds(const StepCosts& costs, const TrainSettings& settings, const Split& train,
                        std::size_t initial, int iterations) {
  const auto end = splats_at(settings, initial, settings.iterations);
  std::vector<PlanLevel> levels;
  for (const PyramidLevel& level : pyramid_levels(settings, train)) {
    const auto cost = std::ranges::find(costs.levels, level.factor,
                                        [](const PlanLevel& known) { return known.level.factor; });
    if (cost == costs.levels.end())
      fail(ErrorKind::internal, "no cost of images reduced by {}", level.factor);
    const double slope = costs.more > costs.few ? std::max(0.0, cost->end_ms - cost->start_ms) /
                                                      (double{1} * costs.more - costs.few)
                                                : 0;
    // Never below a tenth of what was measured, however few splats.
    const auto at = [&](double splats) {
      return std::max(0.1 * cost->start_ms, cost->start_ms + slope * (splats - costs.few));
    };
    levels.push_back({level, at(static_cast<double>(initial)), at(end), cost->sweep_ms});
  }
  return costs.over_pilot *
         training_seconds(settings, levels, static_cast<std::uint32_t>(initial), end, iterations);
}

TrainSettings rehearsal(const BudgetRun& run, const TrainSettings& base, std::size_t points, double budget) {
  const double share = std::min(kRehearsalShare, kRehearsalSeconds / budget);
  const int iterations =
      std::min(run.settings.iterations, std::max({kMinIterations, kRehearsalViews / run.settings.batch,
                                                  static_cast<int>(share * run.settings.iterations)}));
  TrainSettings settings = run.settings;
  settings.chosen.insert("cap_max");  // the run's, though it may be the usual one
  settings.growth = base.growth;      // for short_schedule() to choose, where nobody did
  settings.refine.step = base.refine.step;
  // The usual step is for a long run: a short one would refine at each of its own.
  for (const char* key : {"refine", "refine_every"}) settings.chosen.erase(key);
  for (const auto& [key, rate, power] : kFallingRates) settings.*rate = base.*rate;
  settings.beta_dir_init = base.beta_dir_init;
  settings.pyramid = base.pyramid == short_run_settings().pyramid ? kRehearsalPyramid : base.pyramid;
  settings = short_schedule(settings, iterations, points);
  settings.on_nan = OnNan::stop;
  settings.refine_cameras = RefineCameras::none;  // its sweeps take as long as those of the run
  settings.eval_every = "0";
  return settings;
}

void rehearse_budget(Device& device, const TrainSettings& settings, const Split& train,
                     const SplatModel& initial, StepCosts& costs) {
  const auto start = Clock::now();
  const Split none{"test", {}};
  Trainer trainer(device, settings, train, none, initial);
  trainer.run([](const StepReport&) { return true; });
  costs.over_pilot = 1;
  costs.over_pilot =
      trainer.seconds() / expected_seconds(costs, settings, train, initial.count, settings.iterations);
  costs.spent += seconds_since(start);
}

BudgetRun fit_budget(const StepCosts& costs, const TrainSettings& settings, const Split& train,
                     std::size_t points, double budget, const PictureFacts& pictures, double aim) {
  const auto seconds = [&](int iterations) {
    const TrainSettings s = short_schedule(settings, iterations, points, pictures);
    return expected_seconds(costs, s, train, first_splats(s, points), iterations);
  };
  if (const double least = seconds(kMinIterations); least > budget)
    fail(ErrorKind::usage,
         "{} iterations, the fewest that make sense, are expected to take {:.3g} s on this device, and the "
         "budget is {:.3g} s: give more time, or reduce the images with downscale",
         kMinIterations, least, budget);
  int fits = kMinIterations, beyond = kScheduleLength + 1;
  while (beyond - fits > 1) {
    const int middle = fits + (beyond - fits) / 2;
    (seconds(middle) <= aim * budget ? fits : beyond) = middle;
  }
  BudgetRun run{short_schedule(settings, fits, points, pictures), 0, {}, fits == kScheduleLength};
  const std::size_t initial = first_splats(run.settings, points);
  for (int percent = 0; percent <= 100; ++percent)
    run.curve.push_back(expected_seconds(costs, run.settings, train, initial,
                                         static_cast<int>(std::int64_t{percent} * fits / 100)));
  run.seconds = run.curve.back();
  return run;
}

}  // namespace ubs
