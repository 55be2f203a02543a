// SPDX-License-Identifier: Apache-2.0
#include "host/train/time_budget.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "host/base/error.hpp"
#include "host/base/warning.hpp"

namespace ubs {
namespace {

constexpr int kSamples = 400;          // number of parts of the work whose time is computed separately
constexpr double kMinStepShare = 0.1;  // minimum time of a step, as a share of fixed_ms
// At a point, the number of iterations for the whole work is multiplied by a factor between these two.
constexpr double kLeastChange = 0.5, kMostChange = 1.5;
constexpr double kFresh = 0.5;  // weight of the latest measurement in slowness_
// The distance between two points is 1/kPoints of the iterations of the whole run, but at least log_every. If
// this is more than 1/kPointsOfRest of the remaining iterations, the distance is reduced to this share.
constexpr int kPoints = 100, kPointsOfRest = 10;
// Used by cooldown_seconds(): a share of the training time, and a minimum and a maximum in seconds.
constexpr double kCooldownShare = 0.1, kLeastCooldown = 5, kMostCooldown = 60;
// Minimum of the time for the rest of a run whose budget was changed, relative to the time of its camera
// sweeps. Less time would leave too few iterations between the sweeps.
constexpr double kSweepTimes = 2;
// A run has enough iterations to train a certain number of splats. Growth ends when there are more than this
// multiple of it.
constexpr double kSpareSplats = 2;

// Rounds a share to a few digits, to keep config.yaml readable.
double rounded_share(double share) { return std::stod(fmt::format("{:.6f}", share)); }

}  // namespace

double StepCost::step_ms(double splats) const {
  return std::max(fixed_ms + each_ms * splats, kMinStepShare * fixed_ms);
}

std::string shares_until(const TrainSettings& settings, int iteration) {
  std::vector<SharePoint> points = share_points(settings);
  if (points.empty() || points.back().share < 1) points.push_back({settings.iterations, 1});
  std::vector<SharePoint> kept;
  SharePoint at;
  for (const SharePoint& point : points) {
    if (at.iteration >= iteration) break;
    kept.push_back(point);
    at = reached(at, point);
    if (at.iteration > iteration) kept.back().left_at = iteration;
  }
  return to_string(kept);
}

double cooldown_seconds(double trained, double left) {
  return std::min(std::clamp(kCooldownShare * trained, kLeastCooldown, kMostCooldown), left);
}

WorkTime::WorkTime(const std::vector<StepCost>& costs, const Schedule& schedule,
                   const std::vector<PyramidLevel>& levels) {
  const auto cost_at = [&](double share) -> const StepCost& {
    const int factor = factor_at(levels, share);
    const auto cost = std::ranges::find(costs, factor, &StepCost::factor);
    if (cost == costs.end())
      fail(ErrorKind::internal, "the cost of images that are reduced by {} has not been measured", factor);
    return *cost;
  };
  left_.assign(kSamples + 1, 0);
  for (int k = kSamples - 1; k >= 0; --k) {
    const double share = (k + 0.5) / kSamples;
    left_[static_cast<std::size_t>(k)] = left_[static_cast<std::size_t>(k) + 1] +
                                         1e-3 * cost_at(share).step_ms(schedule.splats_at(share)) / kSamples;
  }
  for (const double share : Schedule::camera_sweep_shares())
    sweeps_.push_back({share, 1e-3 * cost_at(share).sweep_ms});
}

double WorkTime::steps_left(double share) const {
  const double at = std::clamp(share, 0.0, 1.0) * kSamples;
  const auto k = std::min(static_cast<std::size_t>(at), static_cast<std::size_t>(kSamples - 1));
  return left_[k] + (left_[k + 1] - left_[k]) * (at - static_cast<double>(k));
}

double WorkTime::sweeps_left(double share) const {
  double seconds = 0;
  for (const Sweep& sweep : sweeps_)
    if (sweep.share > share) seconds += sweep.seconds;
  return seconds;
}

void use_speed(TimeBudget& budget, const TrainSettings& settings, const Split& train,
               const TrainProgress& progress, double swept) {
  const std::vector<PyramidLevel> levels = pyramid_levels(settings, train);
  const WorkShare work(settings);
  const auto pixels = [](int factor) { return 1.0 / (factor * factor); };  // relative to full size
  double done = 0;
  for (int i = 1; i <= progress.iteration; ++i) done += pixels(factor_at(levels, work, i));
  const double full_ms = 1e3 * (progress.seconds - swept) / std::max(done, 1.0);
  budget.most_iterations =
      std::max({budget.most_iterations, settings.iterations, progress.iteration + kScheduleLength});
  budget.first_iterations = settings.iterations;
  for (const PyramidLevel& level : levels)
    budget.costs.push_back({.factor = level.factor, .fixed_ms = full_ms * pixels(level.factor)});
}

TrainSettings with_iterations(TrainSettings asked, const Facts& facts, int iterations) {
  asked.find_points = points_to_find(asked, facts.moves);  // depends on the budget
  asked.iterations = iterations;
  asked.budget = "none";
  return asked;
}

double expected_seconds(int iterations, const std::vector<StepCost>& costs, const TrainSettings& asked,
                        const Facts& facts, const Split& train) {
  const TrainSettings s = settle(with_iterations(asked, facts, iterations), facts).plan.settings();
  const WorkTime time(costs, Schedule(s, first_splats(s, facts)), pyramid_levels(s, train));
  return iterations * time.steps_left(0) + time.sweeps_left(0);
}

BudgetedRun choose_iterations(TimeBudget budget, const TrainSettings& asked, const Facts& facts,
                              const Split& train) {
  const auto seconds = [&](int iterations) {
    return expected_seconds(iterations, budget.costs, asked, facts, train);
  };
  const double least = seconds(kMinIterations);
  if (least > budget.seconds)
    fail(ErrorKind::usage,
         "the minimum of {} iterations would take {:.3g} s, which exceeds the budget of {:.3g} s: increase "
         "the budget, or reduce the images with downscale",
         kMinIterations, least, budget.seconds);
  if (budget.spent + least > budget.seconds) {
    warn(
        "{:.3g} s of the budget of {:.3g} s passed before the first iteration. The minimum of {} iterations "
        "takes {:.3g} s more, so the budget will be exceeded",
        budget.spent, budget.seconds, kMinIterations, least);
    budget.seconds = budget.spent + least;
  }
  int fits = kMinIterations, beyond = budget.most_iterations + 1;
  while (beyond - fits > 1) {
    const int middle = fits + (beyond - fits) / 2;
    (budget.spent + seconds(middle) <= budget.seconds ? fits : beyond) = middle;
  }
  budget.first_iterations = fits;
  return {settle(with_iterations(asked, facts, fits), facts), std::move(budget)};
}

BudgetPace::BudgetPace(TimeBudget budget, const TrainSettings& settings, const Split& train,
                       std::size_t initial)
    : budget_(std::move(budget)),
      time_(budget_.costs, Schedule(settings, initial), pyramid_levels(settings, train)) {}

void BudgetPace::begin(const WorkShare& work, int iteration, double seconds, double swept) {
  since_ = {iteration, work.at(iteration), seconds, swept};
}

void BudgetPace::measure(const WorkShare& work, int iteration, double seconds, double swept) {
  const double share = work.at(iteration);
  if (iteration <= since_.iteration || share <= since_.share) return;
  const double per_share = (iteration - since_.iteration) / (share - since_.share);
  const double expected = per_share * (time_.steps_left(since_.share) - time_.steps_left(share));
  swept_ += swept - since_.swept;
  sweeps_expected_ += time_.sweeps_left(since_.share) - time_.sweeps_left(share);
  const double took = seconds - since_.seconds - (swept - since_.swept);
  slowness_ += kFresh * (took / expected - slowness_);
  begin(work, iteration, seconds, swept);
}

double BudgetPace::sweeps_left(double share) const {
  return time_.sweeps_left(share) * (sweeps_expected_ > 0 ? swept_ / sweeps_expected_ : 1);
}

// Steps may have been slow because the machine is slow, or because splats were large for a while. Early in a
// run, both reasons are equally likely (docs/results/2026-11-26-share-of-the-work.md). Therefore, only a part
// of the measured slowness is applied to the rest of the run, and this part grows with the share of the work
// that is done.
double BudgetPace::slowness_of_rest(double share) const {
  return std::pow(std::max(slowness_, 1e-6), std::sqrt(share));
}

double BudgetPace::seconds_left(const WorkShare& work, int iteration) const {
  const double share = work.at(iteration);
  return slowness_of_rest(share) * work.iterations_per_share(iteration) * time_.steps_left(share) +
         sweeps_left(share);
}

double BudgetPace::iterations_per_share(const WorkShare& work, int iteration, double seconds,
                                        bool any_change) const {
  if (iteration == 0) return budget_.first_iterations;
  const double share = work.at(iteration);
  const double left = std::max(0.0, budget_.seconds - seconds - sweeps_left(share));
  const double steps = slowness_of_rest(share) * time_.steps_left(share);
  const double fits = left / std::max(steps, 1e-12), before = work.iterations_per_share(iteration);
  return any_change ? fits : std::clamp(fits, kLeastChange * before, kMostChange * before);
}

void BudgetPace::advance(TrainSettings& settings, int iteration, double seconds, double swept,
                         bool any_change) {
  const WorkShare work(settings);
  measure(work, iteration, seconds, swept);
  const double share = work.at(iteration);
  if (const double left = budget_.seconds - seconds, sweeps = sweeps_left(share);
      any_change && left < kSweepTimes * sweeps) {
    budget_.seconds = seconds + kSweepTimes * sweeps;
    warn(
        "the rest of the run takes about {:.3g} s instead of {:.3g} s, because refining the cameras takes "
        "about {:.3g} s",
        kSweepTimes * sweeps, left, sweeps);
  }
  const double per_share = iterations_per_share(work, iteration, seconds, any_change);
  const int rest = std::clamp(static_cast<int>(std::lround(per_share * (1 - share))), 1,
                              std::max(1, budget_.most_iterations - iteration));
  const int apart = std::max(
      1, std::min(std::max(settings.log_every, static_cast<int>(per_share) / kPoints), rest / kPointsOfRest));
  std::vector<SharePoint> points = share_points(settings);
  const double next = rounded_share(share + (1 - share) * apart / rest);
  if (apart < rest && next > share && next < 1)
    points.push_back({iteration + apart, next});
  else
    points.push_back({iteration + rest, 1});
  settings.iterations = iteration + rest;
  settings.work_shares = to_string(points);
}

void BudgetPace::complete(TrainSettings& settings, int iteration, double seconds, double swept, double within,
                          std::uint32_t splats) {
  const WorkShare work(settings);
  measure(work, iteration, seconds, swept);
  budget_.seconds = seconds + within;
  settings.work_shares = shares_until(settings, iteration);
  if (const double share = work.at(iteration); share < kLastPart || share == 1) {
    std::vector<SharePoint> points = share_points(settings);
    points.push_back({++iteration, kLastPart});
    settings.iterations = std::max(settings.iterations, iteration + 1);
    settings.work_shares = to_string(points);
    // If fewer splats were added than the schedule allows, steps take less time than planned. Correct for
    // this.
    const auto full = std::ranges::find(budget_.costs, 1, &StepCost::factor);
    if (full != budget_.costs.end())
      slowness_ *= 1e-3 * full->step_ms(splats) * (1 - kLastPart) / time_.steps_left(kLastPart);
  }
  begin(WorkShare(settings), iteration, seconds, swept);
  advance(settings, iteration, seconds, swept, true);
}

bool BudgetPace::serves_more(std::uint32_t splats, const TrainSettings& settings) const {
  return splats <= kSpareSplats * settings.cap_max * settings.iterations / budget_.first_iterations;
}

}  // namespace ubs
