// SPDX-License-Identifier: Apache-2.0
// Tests evaluations and checkpoints whose intervals are set in seconds. With a simulated clock, the tests
// check when they take place on fast, slow and loaded machines and after a pause, and that the model does
// not depend on the evaluations.
#include <catch2/catch.hpp>
#include <cmath>
#include <functional>

#include "tests/pipeline/training_runs.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/simulated_time.hpp"

namespace ubs {
namespace {

constexpr int kIterations = 60;
constexpr double kInterval = 10;  // seconds

// A simulated machine, which is described by the duration of each iteration.
struct Course {
  const char* name;
  std::function<double(int iteration)> seconds;
};

std::vector<Course> courses() {
  return {{"as expected", [](int) { return 1.0; }},
          {"ten times slower", [](int) { return 10.0; }},
          {"ten times faster", [](int) { return 0.1; }},
          {"a load in the middle", [](int i) { return i > 20 && i <= 40 ? 4.0 : 1.0; }},
          {"stopped for ten minutes", [](int i) { return i == 30 ? 600.0 : 1.0; }},
          {"a clock that stands still", [](int) { return 0.0; }}};
}

struct TimedRun {
  std::vector<int> evaluations, saves;  // iterations
  std::vector<double> seconds;          // training time that is reported after each iteration
  SplatModel model;
};

// Runs training with evaluations or, if `saves` is true, with saved states every 10 seconds. The clock
// advances after each iteration. The time of an iteration in which a state is saved is not counted, because
// saving is not training.
TimedRun run_timed(Device& device, TrainSettings settings, const test::Data& data, bool saves,
                   const Course& course) {
  if (!saves) settings.eval_every = "10s";
  test::SimulatedTime time;
  Trainer trainer(device, settle(settings), data.train, saves ? test::kNone : data.test,
                  test::start(settings), alone(), time);
  TimedRun run;
  if (saves)
    trainer.on_state({0, kInterval, [&](const TrainState& state) { run.saves.push_back(state.iteration); }});
  trainer.run([&](const StepReport& report) {
    if (report.test) run.evaluations.push_back(report.iteration);
    run.seconds.push_back(report.seconds);
    time.advance(course.seconds(report.iteration));
    return true;
  });
  run.model = trainer.model();
  return run;
}

// Returns the iterations first, first + step, ... before the last one.
std::vector<int> every(int first, int step) {
  std::vector<int> iterations;
  for (int i = first; i < kIterations; i += step) iterations.push_back(i);
  return iterations;
}

TEST_CASE("training time: evaluations take place every ten seconds, and do not change the model", "[time]") {
  const test::Data data = test::synthetic("glossy", 16, 3);
  const TrainSettings settings = test::short_run(3, kIterations, 200);
  const auto device = devices_under_test()[0];
  std::vector<float> first;
  for (const Course& course : courses()) {
    INFO(course.name);
    const TimedRun run = run_timed(*device, settings, data, false, course);
    double passed = 0;
    std::vector<int> due;
    for (int i = 1; i <= kIterations; ++i) {
      CHECK(run.seconds[static_cast<std::size_t>(i - 1)] == Approx(passed).margin(1e-6));
      const double before = i > 1 ? passed - course.seconds(i - 1) : 0;
      if (i == kIterations ||
          std::floor((passed + 1e-7) / kInterval) > std::floor((before + 1e-7) / kInterval))
        due.push_back(i);
      passed += course.seconds(i);
    }
    CHECK(run.evaluations == due);
    if (first.empty()) first = run.model.values;
    CHECK(test::same_bits(run.model.values, first));
  }
}

TEST_CASE("training time: states are saved every ten seconds of training", "[time]") {
  const test::Data data = test::synthetic("glossy", 16, 3);
  const TrainSettings settings = test::short_run(3, kIterations, 200);
  const auto device = devices_under_test()[0];
  const auto saves = [&](const Course& course) {
    INFO(course.name);
    return run_timed(*device, settings, data, true, course).saves;
  };
  const std::vector<Course> all = courses();
  // Ten iterations take 10 s. The time of the iteration that saves is not counted.
  CHECK(saves(all[0]) == every(11, 11));
  CHECK(saves(all[1]) == every(2, 2));
  CHECK(saves(all[2]).empty());  // the run only takes 6 s
  const std::vector<int> loaded = saves(all[3]);
  CHECK(loaded == std::vector<int>{11, 22, 26, 30, 34, 38, 43, 54});
  // A long pause counts as one interval, and the next ones start after it.
  CHECK(saves(all[4]) == std::vector<int>{11, 22, 31, 42, 53});
  CHECK(saves(all[5]).empty());
}

}  // namespace
}  // namespace ubs
