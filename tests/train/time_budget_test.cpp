// SPDX-License-Identifier: Apache-2.0
// Tests time budgets (--budget). The number of iterations is chosen from measured step times. Runs must end
// in time on simulated machines that are faster, slower or loaded. The settings of a finished run must give
// the same model without a clock.
#include "host/train/time_budget.hpp"

#include <catch2/catch.hpp>
#include <functional>

#include "host/base/text.hpp"
#include "host/base/warning.hpp"
#include "host/settings/fields.hpp"
#include "host/train/measure_steps.hpp"
#include "tests/pipeline/training_runs.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/simulated_time.hpp"

namespace ubs {
namespace {

using test::message_of;

Split views_of(int side) {
  View view;
  view.camera.width = view.camera.height = side;
  return {"train", {view}};
}

// Returns step times for three levels of the image pyramid. On full images, a step takes 1 ms, plus 1 ms per
// thousand splats. On images of half the size, it takes half of this time, and on the smallest images a
// fifth.
std::vector<StepCost> some_costs() { return {{4, 0.2, 0.0002, 0}, {2, 0.5, 0.0005, 0}, {1, 1, 0.001, 0}}; }

TimeBudget budget_of(double seconds) { return {.seconds = seconds, .spent = 0.5, .costs = some_costs()}; }

// Describes how a simulated machine differs from the measured step times. `slowness` returns the factor of
// the step time after a number of seconds.
struct Machine {
  const char* name;
  std::function<double(double seconds)> slowness;
  double stop_at = -1, stop = 0;  // the machine stops after `stop_at` seconds, for `stop` seconds; -1: never
  double coarse = 1;              // additional factor for steps on reduced images
};

std::vector<Machine> machines() {
  const auto constant = [](double factor) { return [factor](double) { return factor; }; };
  return {{"as measured", constant(1)},
          {"30 % slower", constant(1.3)},
          {"ten times slower", constant(10)},
          {"ten times faster", constant(0.1)},
          {"a load in the middle", [](double s) { return s > 15 && s < 30 ? 3.0 : 1.0; }},
          {"a load at the end", [](double s) { return s > 30 ? 3.0 : 1.0; }},
          {"a load at the beginning", [](double s) { return s < 10 ? 4.0 : 1.0; }},
          {"reduced images slower than measured", constant(1), -1, 0, 2.5},
          {"reduced images faster than measured", constant(1), -1, 0, 0.4},
          {"a load that comes and goes", [](double s) { return std::fmod(s, 4) < 2 ? 2.0 : 1.0; }},
          {"a stop of six seconds", constant(1), 20, 6}};
}

const Facts kPoints{.points = 9000};

// Returns the settings of a run with the schedule fast.
TrainSettings fast_run() {
  TrainSettings settings;
  settings.dim = 6;
  return settings;
}

struct Simulated {
  TrainSettings settings;
  double seconds = 0;
  int first_iterations = 0;
};

// Simulates a run with a time budget on a machine. Does the same as Trainer, but without a device. After
// `end_early` seconds, the user ends the run early, so that the rest of the schedule must be completed within
// cooldown_seconds().
Simulated simulate(TimeBudget asked, const TrainSettings& base, std::size_t points, const Machine& machine,
                   double end_early = 1e9) {
  const Split train = views_of(800);
  auto [settled, budget] = choose_iterations(std::move(asked), base, {.points = points}, train);
  TrainSettings settings = settled.plan.settings();
  const std::vector<PyramidLevel> levels = pyramid_levels(settings, train);
  BudgetPace pace(budget, settings, train, points);
  double now = budget.spent, swept = 0;
  bool stopped = false;
  std::uint32_t splats = UINT32_MAX;  // maximum, after growth has ended early
  pace.begin(WorkShare(settings), 0, now, 0);
  pace.advance(settings, 0, now, 0);
  Schedule schedule(settings, points);
  for (int i = 1; i <= settings.iterations; ++i) {
    const double share = schedule.work().at(i);
    const int factor = factor_at(levels, schedule.work(), i);
    const StepCost& cost = *std::ranges::find(budget.costs, factor, &StepCost::factor);
    const double factor_now = machine.slowness(now) * (factor > 1 ? machine.coarse : 1);
    now += 1e-3 * factor_now * cost.step_ms(std::min(schedule.splats_at(share), splats));
    if (schedule.camera_sweep(i)) {
      const double seconds = 1e-3 * factor_now * cost.sweep_ms;
      now += seconds;
      swept += seconds;
    }
    if (!stopped && machine.stop_at >= 0 && now > machine.stop_at) {
      now += machine.stop;
      stopped = true;
    }
    if (i == schedule.work().last().iteration && i < settings.iterations) {
      pace.advance(settings, i, now, swept);
      validate(settings);
      schedule = schedule.with(settings);
    }
    if (now >= end_early && i < settings.iterations) {
      const double within = cooldown_seconds(now, pace.seconds_left(schedule.work(), i));
      splats = schedule.splats_at(share);
      pace.complete(settings, i, now, swept, within, splats);
      validate(settings);
      schedule = schedule.with(settings);
      end_early = 1e9;
    }
  }
  return {settings, now, budget.first_iterations};
}

}  // namespace

TEST_CASE("time budget: durations are parsed, and invalid ones are rejected", "[budget]") {
  for (const auto& [text, seconds] : {std::pair{"90", 90.0},
                                      {"90s", 90.0},
                                      {"1.5m", 90.0},
                                      {"2h", 7200.0},
                                      {"2min", 120.0},
                                      {"10 minutes", 600.0},
                                      {"1h30m", 5400.0},
                                      {"1h 30 sec", 3630.0}})
    CHECK(parse_duration(text, "budget") == seconds);
  for (const char* wrong : {"", "s", "-5s", "0", "1d", "nan", "1e9h", "1h-3m", "1h 30min?", "inf"})
    CHECK(message_of([&] { parse_duration(wrong, "budget"); }, ErrorKind::usage).find("90s") !=
          std::string::npos);
}

TEST_CASE("time budget: the time of a schedule is the sum of its steps and sweeps", "[budget]") {
  TrainSettings settings = test::published();
  settings.refine = {0, 0, 1};
  settings.pyramid = "4:0.25,2:0.5";
  std::vector<StepCost> costs = some_costs();
  costs[2].sweep_ms = 1000;
  const WorkTime time(costs, Schedule(settings, 2000), pyramid_levels(settings, views_of(800)));
  CHECK(time.steps_left(0) == Approx(1e-3 * (0.25 * 0.6 + 0.25 * 1.5 + 0.5 * 3)));
  CHECK(time.steps_left(0.75) == Approx(1e-3 * 0.25 * 3));
  CHECK(time.steps_left(1) == 0);
  // Cameras are refined 20 times. Half of these refinements use images of full size, and each of them takes
  // 1 s.
  CHECK(time.sweeps_left(0) == Approx(10));
  CHECK(time.sweeps_left(0.95) == 0);
  CHECK_THROWS_AS(
      WorkTime({some_costs()[0]}, Schedule(settings, 2000), pyramid_levels(settings, views_of(800))), Error);
}

TEST_CASE("time budget: as many iterations are chosen as fit into the budget", "[budget]") {
  const Split train = views_of(800);
  int before = 0;
  for (const double seconds : {5.0, 30.0, 90.0, 600.0}) {
    const BudgetedRun run = choose_iterations(budget_of(seconds), fast_run(), kPoints, train);
    const TrainSettings& settings = run.settled.plan.settings();
    INFO(seconds << " s: " << settings.iterations << " iterations");
    CHECK(settings.iterations == run.budget.first_iterations);
    CHECK(settings.iterations > before);
    before = settings.iterations;
    const WorkTime time(run.budget.costs, Schedule(settings, 9000), pyramid_levels(settings, train));
    const double expected = settings.iterations * time.steps_left(0);
    CHECK(expected <= seconds - 0.5);
    CHECK(expected > 0.97 * (seconds - 0.5));
  }
  TimeBudget bounded = budget_of(1e6);
  bounded.most_iterations = 16000;
  CHECK(choose_iterations(bounded, fast_run(), kPoints, train).settled.plan.settings().iterations == 16000);
  const std::string refusal =
      message_of([&] { choose_iterations(budget_of(0.1), fast_run(), kPoints, train); }, ErrorKind::usage);
  CHECK(refusal.find("increase the budget") != std::string::npos);
  // If preparing the run has taken longer than the budget, the run gets the minimum number of iterations, and
  // the budget is increased for them.
  TimeBudget late = budget_of(20);
  late.spent = 50;
  std::string warning;
  set_log([&](LogLevel, const std::string& text) { warning += text; });
  const BudgetedRun least = choose_iterations(late, fast_run(), kPoints, train);
  set_log({});
  CHECK(least.settled.plan.settings().iterations == kMinIterations);
  CHECK(least.budget.seconds > 50);
  CHECK(least.budget.seconds < 51);
  CHECK(warning.find("50 s of the budget of 20 s passed") != std::string::npos);
}

TEST_CASE("time budget: on fast, slow and loaded machines, runs miss the budget by at most 2 % and 2 s",
          "[budget]") {
  std::vector<StepCost> with_sweeps = some_costs();
  for (StepCost& cost : with_sweeps) cost.sweep_ms = 300.0 / cost.factor;
  for (const Machine& machine : machines())
    for (const auto& [seconds, sweeps] : {std::pair{45.0, false}, {45.0, true}, {400.0, false}}) {
      TimeBudget budget = budget_of(seconds);
      TrainSettings base = fast_run();
      if (sweeps) {
        budget.costs = with_sweeps;
        base.refine_cameras = RefineCameras::pose;
      }
      const Simulated run = simulate(budget, base, 9000, machine);
      INFO(machine.name << (sweeps ? ", with sweeps: " : ": ") << run.seconds << " s, "
                        << run.settings.iterations << " iterations, first " << run.first_iterations);
      // A run with the maximum number of iterations may end earlier.
      const bool all = run.settings.iterations == kScheduleLength;
      const double tolerance = std::min(0.02 * seconds, 2.0);
      if (!all) CHECK(run.seconds > seconds - tolerance);
      CHECK(run.seconds < seconds + tolerance);
      CHECK(run.settings.iterations <= kScheduleLength);
      CHECK(share_points(run.settings).back().share == 1);
    }
}

// The time to complete the schedule is 10 % of the training time so far, but at least 5 s and at most 60 s,
// and not more than the remaining time.
TEST_CASE("time budget: a run that is ended early gets about 10 % of its time to complete the schedule",
          "[budget]") {
  CHECK(cooldown_seconds(200, 300) == Approx(20));
  CHECK(cooldown_seconds(10, 300) == 5);
  CHECK(cooldown_seconds(3600, 3600) == 60);
  CHECK(cooldown_seconds(200, 3) == 3);
}

TEST_CASE("time budget: a run that is ended early completes its schedule in time", "[budget]") {
  for (const Machine& machine : machines())
    for (const double end_early : {60.0, 200.0, 350.0}) {
      const Simulated run = simulate(budget_of(400), fast_run(), 9000, machine, end_early);
      INFO(machine.name << ", ended early at " << end_early << " s: " << run.seconds << " s, "
                        << run.settings.iterations << " iterations");
      if (run.settings.iterations == kScheduleLength) continue;
      CHECK(run.seconds == Approx(1.1 * end_early).margin(2));  // largest error 1.04 s, due to one slow step
      CHECK(run.settings.work_shares.find('@') != std::string::npos);
      CHECK(share_points(run.settings).back().share == 1);
    }
}

TEST_CASE("time budget: a run that has lost time ends soon, with its complete schedule", "[budget]") {
  const Machine stopped{"a stop of ten minutes", [](double) { return 1.0; }, 20, 600};
  const Simulated run = simulate(budget_of(45), fast_run(), 9000, stopped);
  CHECK(run.seconds < 620 + 3);
  CHECK(share_points(run.settings).back().share == 1);
}

TEST_CASE("time budget: if the maximum number of iterations fits, settings do not depend on the clock",
          "[budget]") {
  std::vector<std::string> shares;
  for (const Machine& machine : machines()) {
    TimeBudget budget = budget_of(1e5);
    budget.most_iterations = 2000;
    const Simulated run = simulate(budget, fast_run(), 9000, machine);
    CHECK(run.settings.iterations == 2000);
    shares.push_back(run.settings.work_shares);
  }
  for (const std::string& other : shares) CHECK(other == shares[0]);
}

namespace {

TimeBudget small_budget() { return {.seconds = 30, .spent = 1, .costs = {{1, 100, 0, 0}}}; }

struct Trained {
  TrainSettings settings;
  SplatModel model;
  double seconds = 0;
  std::uint32_t splats = 0;
};

TrainSettings budgeted_settings() {
  TrainSettings settings = test::short_run(6, 250, 300);
  settings.cap_max = 900;
  settings.growth = 1.1;
  settings.refine.step = 1000;
  settings.lr_cooldown = 0.2;
  settings.log_every = 5;
  return settings;
}

// Checks that the settings of a finished run give a bit-identical model without a clock.
void check_repeats(Device& device, const test::Data& data, const TrainSettings& ended,
                   const std::vector<float>& values) {
  Trainer again(device, settle(ended), data.train, test::kNone, test::start(budgeted_settings()));
  again.run([](const StepReport&) { return true; });
  CHECK(test::same_bits(again.model().values, values));
}

// A state of a run, and the settings of the run at this time.
struct Kept {
  TrainState state;
  TrainSettings settings;
};
// Trains with a budget and a simulated clock, on which iteration i takes seconds_of(i) seconds. If `from` is
// not null, resumes the run from this state. If `keep_at_80` is not null, stores the state at iteration 80
// there. If `budget_seconds` is not 0, it replaces the budget.
Trained train_in_time(Device& device, const test::Data& data, TrainSettings settings,
                      const std::function<double(int)>& seconds_of, const Kept* from = nullptr,
                      Kept* keep_at_80 = nullptr, double budget_seconds = 0) {
  test::SimulatedTime time;
  const SplatModel first = test::start(settings);
  TimeBudget budget = small_budget();
  budget.first_iterations = settings.iterations;
  if (from) settings = from->settings;
  if (budget_seconds > 0) {
    budget.seconds = budget_seconds;
    settings.work_shares = shares_until(settings, from->state.iteration);
  }
  Trainer trainer(device, settle(settings), data.train, test::kNone, first, alone(), time);
  if (from) trainer.restore(from->state);
  trainer.keep_to(budget);
  Trained out;
  time.advance(seconds_of(trainer.iteration() + 1));
  trainer.run([&](const StepReport& report) {
    out.seconds = report.seconds;
    if (keep_at_80 && report.iteration == 80) *keep_at_80 = {trainer.state(), trainer.settings()};
    time.advance(seconds_of(report.iteration + 1));
    return true;
  });
  out.settings = trainer.settings();
  out.model = trainer.model();
  out.splats = trainer.splats();
  return out;
}

}  // namespace

TEST_CASE("time budget: the settings of a finished or resumed run give the same model again", "[budget]") {
  const test::Data data = test::synthetic("glossy", 32, 4);
  const TrainSettings settings = budgeted_settings();
  const auto as_measured = [](int) { return 0.1; };
  const auto loaded = [](int i) { return i > 60 && i < 110 ? 0.3 : 0.1; };
  const auto slow = [](int) { return 0.35; };
  for (const auto& device : devices_under_test())
    for (const std::function<double(int)>& seconds_of :
         {std::function<double(int)>(as_measured), {loaded}, {slow}}) {
      Kept kept;
      const Trained run = train_in_time(*device, data, settings, seconds_of, nullptr, &kept);
      INFO(run.settings.iterations << " iterations, " << run.seconds << " s, " << run.settings.work_shares);
      CHECK(run.seconds == Approx(30).margin(0.6));
      validate(run.settings);
      // The settings are converted to text and back, as in config.yaml.
      TrainSettings read = settings;
      TrainSettings written = run.settings;
      for (const char* key : {"iterations", "work_shares", "growth_end"})
        for (const FieldValue& field : bind_fields(written, train_fields()))
          if (field.key == std::string(key))
            set_field(bind_fields(read, train_fields()), key, field_text(field), "test");
      check_repeats(*device, data, read, run.model.values);
      // Resumes the run from a state in the middle, first without a clock and then with the same clock.
      TrainSettings rest = read;
      Trainer without(*device, settle(rest), data.train, test::kNone, test::start(settings));
      without.restore(kept.state);
      without.run([](const StepReport&) { return true; });
      CHECK(test::same_bits(without.model().values, run.model.values));
      const Trained continued = train_in_time(*device, data, settings, seconds_of, &kept);
      CHECK(continued.seconds == Approx(30).margin(0.6));
      const std::string begun = kept.settings.work_shares;
      CHECK(continued.settings.work_shares.starts_with(begun));
      // Resumes the run with less or more time for the rest. The schedule must be completed, and the settings
      // must give the same model again.
      for (const double more : {5.0, 40.0}) {
        const double end = kept.state.seconds + more;
        const Trained other = train_in_time(*device, data, settings, seconds_of, &kept, nullptr, end);
        INFO(more << " s more: " << other.seconds << " s of " << end << ", " << other.settings.work_shares);
        CHECK(other.seconds == Approx(end).margin(1));
        CHECK(share_points(other.settings).back().share == 1);
        check_repeats(*device, data, other.settings, other.model.values);
      }
    }
}

TEST_CASE("time budget: a run without a budget can be completed early, continued and repeated", "[budget]") {
  const test::Data data = test::synthetic("glossy", 128, 4);
  TrainSettings settings = budgeted_settings();
  settings.pyramid = "2:0.5";
  const std::function<void(Trainer&)> nothing = [](Trainer&) {};
  for (const auto& device : devices_under_test()) {
    std::vector<Kept> kept;
    struct Ended {
      TrainSettings settings;
      TrainState state;
    };
    // Trains with a simulated clock. An iteration with images of half the size takes a quarter of the time of
    // the others. If `from` is not null, resumes the run from this state. `begin` is called before run(), and
    // complete_in(8) after iteration `early`.
    const auto train = [&](const TrainSettings& with, const TrainState* from,
                           const std::function<void(Trainer&)>& begin, int early = 0) {
      test::SimulatedTime time;
      Trainer trainer(*device, settle(with), data.train, test::kNone, test::start(settings), alone(), time);
      if (from) trainer.restore(*from);
      begin(trainer);
      trainer.on_state({0, 0, [&](const TrainState& state) { kept.push_back({state, trainer.settings()}); }});
      const auto advance = [&] {
        time.advance(WorkShare(trainer.settings()).at(trainer.iteration() + 1) <= 0.5 ? 0.1 : 0.4);
      };
      advance();
      trainer.run([&](const StepReport& report) {
        if (report.iteration == early) trainer.complete_in(8);
        advance();
        return true;
      });
      validate(trainer.settings());
      return Ended{trainer.settings(), trainer.state()};
    };
    const Ended whole = train(settings, nullptr, nothing);
    CHECK(whole.settings.work_shares.empty());

    const Ended early = train(settings, nullptr, nothing, 74);
    INFO(early.settings.iterations << " iterations, " << early.settings.work_shares);
    CHECK(early.settings.work_shares.starts_with("250:1@75,76:0.85,"));
    CHECK(early.state.seconds == Approx(7.5 + 8).margin(0.8));
    check_repeats(*device, data, early.settings, early.state.model.values);
    REQUIRE(kept.size() == 1);  // the state that was saved before the run began to complete its schedule
    CHECK(kept[0].settings.work_shares.empty());
    const TrainState& before = kept[0].state;
    const Ended resumed = train(settings, &before, nothing);
    CHECK(resumed.settings.work_shares.empty());
    CHECK(test::same_bits(resumed.state.model.values, whole.state.model.values));

    // Resumes the run from this state with a budget for the rest of the schedule, first a short and then a
    // long one.
    for (const double more : {10.0, 100.0}) {
      TrainSettings changed = settings;
      changed.work_shares = shares_until(settings, before.iteration);
      const Ended other = train(
          changed, &before, [&](Trainer& trainer) { trainer.keep_to({.seconds = before.seconds + more}); });
      INFO(more << " s: " << other.state.seconds << ", " << other.settings.work_shares);
      CHECK(other.state.seconds == Approx(before.seconds + more).margin(1));
      CHECK(WorkShare(other.settings).steps() == 250);
      check_repeats(*device, data, other.settings, other.state.model.values);
    }
    // Continues the finished run for 20 s.
    const Ended longer = train(settings, &whole.state, [&](Trainer& trainer) {
      trainer.keep_to({.seconds = whole.state.seconds + 20});
      trainer.go_on_for(20);
    });
    INFO(longer.settings.work_shares);
    CHECK(longer.settings.work_shares.starts_with("250:1,251:0.85,"));
    CHECK(longer.state.seconds == Approx(whole.state.seconds + 20).margin(0.8));
    check_repeats(*device, data, longer.settings, longer.state.model.values);
  }
}

TEST_CASE("time budget: a run that was ended early can be repeated, and resumed with its full time",
          "[budget]") {
  const test::Data data = test::synthetic("glossy", 32, 4);
  const TrainSettings settings = budgeted_settings();
  TimeBudget budget = small_budget();
  budget.first_iterations = settings.iterations;
  for (const auto& device : devices_under_test()) {
    test::SimulatedTime time;
    Trainer trainer(*device, settle(settings), data.train, test::kNone, test::start(settings), alone(), time);
    trainer.keep_to(budget);
    std::vector<Kept> kept;
    trainer.on_state({7, 0, [&](const TrainState& state) {
                        if (state.iteration > 70) kept.push_back({state, trainer.settings()});
                      }});
    double at_request = 0, end = 0;
    time.advance(0.1);
    trainer.run([&](const StepReport& report) {
      if (report.iteration == 74) {
        at_request = report.seconds;
        trainer.complete_in(5);
        CHECK_FALSE(trainer.completed_from());
      }
      end = report.seconds;
      time.advance(0.1);
      return true;
    });
    const TrainSettings ended = trainer.settings();
    INFO(ended.iterations << " iterations, " << end << " s, " << ended.work_shares);
    validate(ended);
    REQUIRE(trainer.completed_from());
    CHECK(trainer.completed_from()->iteration == 75);
    CHECK(trainer.iteration() == ended.iterations);
    CHECK(end == Approx(at_request + 5.1).margin(0.4));
    CHECK(share_points(ended).back().share == 1);
    CHECK(WorkShare(ended).at(76) == kLastPart);
    // The settings give the same model without a clock.
    check_repeats(*device, data, ended, trainer.model().values);
    // The last state was saved before the run began to complete its schedule. A run that is resumed from this
    // state continues as if complete_in() had not been called.
    REQUIRE(kept.size() == 1);
    CHECK(kept[0].state.iteration == 75);
    CHECK(kept[0].settings.work_shares.find('@') == std::string::npos);
    const Trained resumed = train_in_time(
        *device, data, settings, [](int) { return 0.1; }, &kept[0]);
    CHECK(resumed.seconds == Approx(30).margin(0.6));
    CHECK(resumed.settings.work_shares.starts_with(kept[0].settings.work_shares));
  }
}

TEST_CASE("time budget: a finished run can be continued for a given time, and repeated", "[budget]") {
  const test::Data data = test::synthetic("glossy", 32, 4);
  const TrainSettings settings = budgeted_settings();
  TimeBudget budget = small_budget();
  budget.first_iterations = settings.iterations;
  for (const auto& device : devices_under_test()) {
    Trained run = train_in_time(*device, data, settings, [](int) { return 0.1; });
    Trainer first(*device, Plan(run.settings), data.train, test::kNone, test::start(settings));
    first.run([](const StepReport&) { return true; });
    TrainState state = first.state();
    state.seconds = run.seconds;

    test::SimulatedTime time;
    Trainer trainer(*device, Plan(run.settings), data.train, test::kNone, test::start(settings), alone(),
                    time);
    trainer.restore(state);
    budget.seconds = run.seconds + 20;
    trainer.keep_to(budget);
    trainer.go_on_for(20);
    double end = 0;
    time.advance(0.1);
    trainer.run([&](const StepReport& report) {
      CHECK(report.seconds_left >= 0);
      CHECK(report.share >= kLastPart);
      end = report.seconds;
      time.advance(0.1);
      return true;
    });
    const TrainSettings ended = trainer.settings();
    INFO(ended.iterations << " iterations, " << end << " s, " << ended.work_shares);
    validate(ended);
    CHECK(end == Approx(run.seconds + 20).margin(0.4));
    CHECK(ended.iterations > run.settings.iterations + 150);
    CHECK(ended.work_shares.starts_with(run.settings.work_shares + ","));
    CHECK(trainer.splats() == run.splats);
    check_repeats(*device, data, ended, trainer.model().values);
    CHECK_FALSE(test::same_bits(trainer.model().values, run.model.values));
  }
}

TEST_CASE("time budget: if no time is left, work_shares is still valid", "[budget]") {
  TrainSettings settings = test::published();
  settings.iterations = 136;
  // Nearly all work is done after 36 iterations. At this time, 20 s have passed, which is twice the budget.
  settings.work_shares = "36:0.999999";
  TimeBudget budget = budget_of(10);
  budget.most_iterations = 16000;
  BudgetPace pace(budget, settings, views_of(800), 9000);
  pace.begin(WorkShare(settings), 36, 20, 0);
  pace.advance(settings, 36, 20, 0);
  validate(settings);
  CHECK(share_points(settings).back().share == 1);
}

TEST_CASE("time budget: a new budget that is too short for the camera sweeps is extended", "[budget]") {
  TrainSettings settings = test::published();
  settings.iterations = 100;
  settings.work_shares = shares_until(settings, 10);
  // A step takes 0.1 s. Of the 20 sweeps, 19 take place after a tenth of the work, and each takes 1 s.
  BudgetPace pace({.seconds = 10, .first_iterations = 100, .costs = {{1, 100, 0, 1000}}}, settings,
                  views_of(800), 9000);
  pace.begin(WorkShare(settings), 10, 1, 0);
  pace.advance(settings, 10, 1, 0, true);
  validate(settings);
  CHECK(settings.iterations == Approx(10 + 19 / 0.1).margin(2));
}

TEST_CASE("time budget: if steps are slower than expected, fewer splats are added", "[budget]") {
  const test::Data data = test::synthetic("glossy", 32, 4);
  const TrainSettings settings = budgeted_settings();
  for (const auto& device : devices_under_test()) {
    const Trained quick = train_in_time(*device, data, settings, [](int) { return 0.1; });
    CHECK(quick.splats == 900);
    CHECK(quick.settings.growth_end == 1);
    const Trained slow = train_in_time(*device, data, settings, [](int) { return 0.8; });
    INFO(slow.settings.iterations << " iterations, growth until " << slow.settings.growth_end);
    CHECK(slow.splats < 700);
    CHECK(slow.settings.growth_end < 0.6);
  }
}

TEST_CASE("time budget: measure_steps() measures every level and does not change the initial splats",
          "[budget]") {
  const test::Data data = test::synthetic("glossy", 144, 4);
  for (const auto& device : devices_under_test())
    for (const bool cameras : {false, true}) {
      TrainSettings settings = fast_run();
      settings.dim = 3;
      if (cameras) settings.refine_cameras = RefineCameras::pose;
      const SplatModel initial = initialise_random(3, 800, 1);
      const std::vector<float> before = initial.values;
      const std::vector<StepCost> costs = measure_steps(*device, settle(settings), data.train, initial, 1600);
      CHECK(initial.values == before);
      REQUIRE(costs.size() == 2);  // a quarter of 144 pixels is too small for a level of its own
      CHECK(costs[0].factor == 2);
      CHECK(costs[1].factor == 1);
      for (const StepCost& cost : costs) {
        CHECK((cost.step_ms(800) > 0 && cost.step_ms(1600) >= cost.step_ms(800)));
        CHECK((cost.sweep_ms > 0) == cameras);
      }
    }
}

}  // namespace ubs
