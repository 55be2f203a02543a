// SPDX-License-Identifier: Apache-2.0
#include "host/train/measure_steps.hpp"

#include <algorithm>

#include "host/scene/frozen_groups.hpp"
#include "host/train/kernel_warm_up.hpp"

namespace ubs {
namespace {

constexpr int kEndless = 1'000'000;           // iterations of a run that never reaches its end
constexpr int kMinSteps = 3, kMaxSteps = 20;  // number of measured steps per level, after one warm-up step
// Measuring a level ends after this time, if at least kMinSteps have been measured.
constexpr double kEnoughSeconds = 0.03;

}  // namespace

Plan measuring_plan(const Plan& plan, std::size_t most) {
  TrainSettings s = plan.recorded();
  s.refine.end = s.refine.first;
  s.iterations = kEndless;
  s.work_shares.clear();
  s.eval_every = "0";
  s.log_every = 1;  // so that each step reports its time
  s.cap_max = static_cast<int>(most);
  if (s.on_nan != OnNan::off) s.on_nan = OnNan::stop;
  return Plan(s);
}

std::vector<double> step_times(Trainer& trainer, const Split& train, TrainState state) {
  std::vector<double> times;
  int begin = 0;
  for (const PyramidLevel& level : pyramid_levels(trainer.settings(), train)) {
    state.iteration = state.logged = begin;
    begin = static_cast<int>(level.until * kEndless);
    trainer.restore(state);
    double first = 0;
    int steps = -1;
    trainer.run([&](const StepReport& report) {
      if (++steps == 0) first = report.seconds;
      const double took = report.seconds - first;
      if (steps > 0) {
        const double ms = 1e3 * took / steps;
        steps == 1 ? times.push_back(ms) : void(times.back() = ms);
      }
      return steps < kMinSteps || (steps < kMaxSteps && took < kEnoughSeconds);
    });
  }
  return times;
}

TrainState first_state(const Trainer& trainer, SplatModel model, const TrainSettings& settings) {
  TrainState state = trainer.state();
  const ParameterLayout layout = model.layout();
  const auto rows = static_cast<std::size_t>(trained_rows(layout, frozen_groups(layout, settings.freeze)));
  state.moment1.assign(model.count * rows, 0.0f);
  state.moment2 = state.moment1;
  std::ranges::fill(state.loss_sums, 0.0f);
  state.model = std::move(model);
  return state;
}

std::vector<StepCost> measure_steps(Device& device, const Plan& plan, const Split& train,
                                    const SplatModel& initial, std::size_t most) {
  const Split none{"test", {}};
  const Plan measuring = measuring_plan(plan, most);
  Trainer trainer(device, measuring, train, none, initial);
  const std::vector<double> few = step_times(trainer, train, trainer.state());
  std::vector<double> many = few;
  if (most > initial.count)
    many = step_times(trainer, train, first_state(trainer, copies(initial, most), measuring.settings()));
  const auto begin = static_cast<double>(initial.count), end = static_cast<double>(most);
  std::vector<StepCost> costs;
  const std::vector<PyramidLevel> levels = pyramid_levels(plan.settings(), train);
  for (std::size_t k = 0; k < levels.size(); ++k) {
    const double each = most > initial.count ? std::max(0.0, many[k] - few[k]) / (end - begin) : 0;
    costs.push_back({levels[k].factor, few[k] - each * begin, each, 0});
  }
  if (trainer.scene().cameras().refines())
    for (StepCost& cost : costs) cost.sweep_ms = 1e3 * trainer.scene().cameras().sweep_seconds(cost.factor);
  return costs;
}

}  // namespace ubs
