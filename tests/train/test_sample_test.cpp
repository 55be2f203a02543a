// SPDX-License-Identifier: Apache-2.0
// Tests TestSample, which measures the PSNR of a few test views during training. With a simulated clock, the
// tests check at which times it measures, that measuring takes little time, and that the model does not
// depend on the measurements.
#include "host/train/test_sample.hpp"

#include <catch2/catch.hpp>

#include "tests/pipeline/training_runs.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/simulated_time.hpp"

namespace ubs {
namespace {

struct Measurements {
  std::vector<double> shares;  // shares of the completed work at which the sample was measured
  double spent = 0;            // time of all measurements [s]
  std::vector<std::uint32_t> views;
};

// Simulates a training run that takes `seconds`, in which measuring a test view takes `each` seconds.
// `limited` means that the run has a time budget.
Measurements simulate_sample(std::size_t views, double seconds, double each, bool limited = false) {
  TestSample sample(views, limited);
  Measurements course;
  for (int i = 0; i <= 100; ++i) {
    const double share = i / 100.0;
    if (!sample.is_due(share, share * seconds, each)) continue;
    course.shares.push_back(share);
    const SampledPsnr got = sample.measure(
        [&](std::uint32_t view) {
          course.spent += each;
          return 20.0 + view;
        },
        [&] { return course.spent; });
    CHECK(got.views == sample.views().size());
    double mean = 0;
    for (const std::uint32_t view : sample.views()) mean += (20.0 + view) / static_cast<double>(got.views);
    CHECK(got.psnr == Approx(mean));
  }
  course.views = sample.views();
  return course;
}

TEST_CASE("test sample: test views are measured up to four times, in at most 2 % of the time", "[time]") {
  const std::vector<double> all{0.2, 0.4, 0.6, 0.8};
  const Measurements cheap = simulate_sample(200, 60, 0.001);
  CHECK(cheap.shares == all);
  CHECK(cheap.views == std::vector<std::uint32_t>{0, 25, 50, 75, 100, 125, 150, 175});
  CHECK(simulate_sample(3, 60, 0.001).views == std::vector<std::uint32_t>{0, 1, 2});
  // At 20 % of the run, 12 s have passed, of which 2 % are 0.24 s. The first measurement may take half of
  // this, which is enough for two views.
  const Measurements dear = simulate_sample(200, 60, 0.05);
  CHECK(dear.shares == all);
  CHECK(dear.views == std::vector<std::uint32_t>{0, 100});
  // If a view takes 0.3 s, there is no time for a sample at 20 % of the run.
  CHECK(simulate_sample(200, 60, 0.3).shares == std::vector<double>{0.4, 0.6, 0.8});
  CHECK(simulate_sample(200, 60, 2).shares.empty());
  CHECK(simulate_sample(0, 60, 0).shares.empty());
  for (const double each : {0.001, 0.02, 0.05, 0.1, 0.3, 0.9})
    CHECK(simulate_sample(200, 60, each).spent <= 1.2);
  // In a run with a time budget, all samples together also take at most 2 s.
  for (const double each : {0.02, 0.1, 0.3, 0.9}) CHECK(simulate_sample(200, 3600, each, true).spent <= 2);
  CHECK(simulate_sample(200, 3600, 0.1, true).shares == all);
  CHECK(simulate_sample(200, 3600, 0.1, false).views.size() == 8);
  CHECK(simulate_sample(200, 3600, 0.1, true).views.size() == 2);
}

// A clock that advances by `step` with every call.
class RestlessTime final : public TimeSource {
 public:
  double seconds() const override { return now_ += step; }
  double step = 0;

 private:
  mutable double now_ = 1e6;
};

struct Sampled {
  SplatModel model;
  std::vector<int> iterations;
  std::vector<SampledPsnr> samples;
  Metrics test;
};

Sampled sampled_run(Device& device, const TrainSettings& settings, const test::Data& data, bool samples,
                    double step) {
  RestlessTime time;
  time.step = step;
  Trainer trainer(device, settle(settings), data.train, data.test, test::start(settings), alone(), time);
  if (samples) trainer.sample_test();
  Sampled run;
  trainer.run([&](const StepReport& report) {
    if (report.test) run.test = *report.test;
    if (report.sample) {
      run.iterations.push_back(report.iteration);
      run.samples.push_back(*report.sample);
    }
    return true;
  });
  run.model = trainer.model();
  return run;
}

TEST_CASE("test sample: the model does not depend on the sample", "[time]") {
  const test::Data data = test::synthetic("glossy", 16, 3);
  TrainSettings settings = test::short_run(3, 60, 200);
  settings.log_every = 4;
  settings.pyramid = "2:0.5";
  const auto device = devices_under_test()[0];
  const Sampled without = sampled_run(*device, settings, data, false, 0);
  CHECK(without.samples.empty());
  // If the clock does not advance, measurements cost no time, so all views are measured. This happens at the
  // first iterations that are logged at 20, 40, 60 and 80 % of the run or later. At the last iteration, the
  // sample is computed from the evaluation of all test views.
  const Sampled often = sampled_run(*device, settings, data, true, 0);
  CHECK(often.iterations == std::vector<int>{12, 24, 36, 48, 60});
  CHECK(often.samples.back().views == 4);
  CHECK(often.samples.back().psnr == Approx(often.test.mean.psnr_channel_mean));
  CHECK(often.samples.front().psnr < often.samples.back().psnr);
  // If the clock advances with each call, a view takes as long as a step, so there is no time for a sample.
  const Sampled never = sampled_run(*device, settings, data, true, 1);
  CHECK(never.samples.empty());
  for (const Sampled* other : {&often, &never})
    CHECK(test::same_bits(without.model.values, other->model.values));
  // The values of the samples are equal to those of evaluations at the same iterations.
  settings.eval_every = "12";
  RestlessTime still;
  Trainer trainer(*device, settle(settings), data.train, data.test, test::start(settings), alone(), still);
  std::vector<double> whole;
  trainer.run([&](const StepReport& report) {
    if (report.test) whole.push_back(report.test->mean.psnr_channel_mean);
    return true;
  });
  REQUIRE(whole.size() == often.samples.size());
  for (std::size_t i = 0; i < whole.size(); ++i) CHECK(often.samples[i].psnr == Approx(whole[i]));
}

}  // namespace
}  // namespace ubs
