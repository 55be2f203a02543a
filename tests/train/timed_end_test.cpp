// SPDX-License-Identifier: Apache-2.0
// The end of a schedule that takes other iterations: what stays, how many there is time for, and that the
// settings that come out repeat the run.
#include "host/train/timed_end.hpp"

#include <catch2/catch.hpp>

#include "host/spec/settings.hpp"
#include "host/train/pyramid.hpp"
#include "host/train/timeline.hpp"
#include "tests/pipeline/training_runs.hpp"
#include "tests/support/device_fixture.hpp"

namespace ubs {
namespace {

using test::message_of;

TrainSettings settings_of(int iterations, double share) {
  TrainSettings s;
  s.dim = 6;
  s.iterations = iterations;
  s.lr_cooldown.share = share;
  s.pyramid = "4:0.5,2:0.8";
  return resolve_automatic(s);
}

Split wide_views() {
  View view;
  view.camera.width = view.camera.height = 512;
  return {"train", {view}};
}

}  // namespace

TEST_CASE("timed end: all before it stays, and the rest goes through the same schedule", "[budget]") {
  const Split views = wide_views();
  for (const int planned : {101, 1000, 16001})
    for (const double share : {0.15, 0.6, 0.0}) {
      const TrainSettings before = settings_of(planned, share);
      const Schedule schedule(before, 1000, 2.5);
      const ParameterLayout layout(6);
      const int begin = Timeline(before).before_end();
      CHECK(begin == std::llround(0.85 * planned));
      for (const int end : {begin + std::max(1, (planned - begin) / 50), begin + 7, planned, planned + 1,
                            begin + 4 * (planned - begin)}) {
        const TrainSettings after = ending_at(before, end);
        INFO(planned << ", " << share << ": " << end << ", lr_cooldown " << to_string(after.lr_cooldown));
        validate(after);
        CHECK(after.iterations == end);
        CHECK(Timeline(after).length() == planned);
        CHECK(Timeline(after).before_end() == begin);
        if (end == planned) CHECK(after.lr_cooldown == before.lr_cooldown);
        // As text it is the same.
        TrainSettings read = before;
        read.iterations = end;
        set_field(bind_fields(read, train_fields()), "lr_cooldown", to_string(after.lr_cooldown), "test");
        CHECK(read.lr_cooldown == after.lr_cooldown);

        const Schedule ended(after, 1000, 2.5);
        for (int i = 1; i <= begin; i += std::max(1, begin / 50)) {
          CHECK(ended.learning_rates(layout, i) == schedule.learning_rates(layout, i));
          CHECK(ended.splats_at(i) == schedule.splats_at(i));
          CHECK(ended.refines(i) == schedule.refines(i));
        }
        if (share > 0) CHECK(ended.learning_rates(layout, end).front() == 0);
        // The middle of one end is the middle of the other.
        const double half = ended.learning_rates(layout, (begin + end) / 2).front();
        const double wanted = schedule.learning_rates(layout, (begin + planned) / 2).front();
        if (end - begin >= 100) CHECK(half == Approx(wanted).epsilon(0.1));
        for (int i = begin + 1; i <= end; ++i)
          CHECK(ended.learning_rates(layout, i).front() < ended.learning_rates(layout, i - 1).front());
        if (end - begin >= 20) {
          int sweeps = 0;
          for (int i = 1; i <= end; ++i) sweeps += ended.camera_sweep(i).has_value();
          CHECK(sweeps == 20);
        }
        std::vector<PyramidLevel> levels = pyramid_levels(before, views), now = pyramid_levels(after, views);
        levels.back().until = end;
        CHECK(now == levels);
      }
    }
  for (const char* wrong : {"2", "0.15:0", "0.15:nan", "0.15:1:1", "0.15:", ":2", "0.15:1e9"}) {
    TrainSettings s;
    CHECK(message_of([&] { set_field(bind_fields(s, train_fields()), "lr_cooldown", wrong, "test"); },
                     ErrorKind::usage)
              .find("SHARE:STRETCH") != std::string::npos);
  }
}

TEST_CASE("timed end: it takes the time that is left", "[budget]") {
  // Steps on small images take 1 ms, on whole ones `ms`; a loss every tenth.
  const auto end_of = [](double seconds, double ms, const TrainSettings& settings) {
    TimedEnd end(seconds, settings, wide_views());
    double now = 0;
    std::optional<TrainSettings> found;
    for (int i = 1; i <= settings.iterations && !found; ++i) {
      now += i <= 0.8 * settings.iterations ? 1e-3 : 1e-3 * ms;
      StepReport report{.iteration = i, .iterations = settings.iterations, .seconds = now};
      if (i % 10 == 0) report.loss = 0.1;
      found = end.after(report);
      CHECK((!found || i == std::llround(0.85 * settings.iterations)));
    }
    return found ? found->iterations : -1;
  };
  const TrainSettings settings = settings_of(1000, 0.15);
  // 0.8 s and 50 steps of 10 ms are over when it is decided.
  CHECK(end_of(2.8, 10, settings) == 1000);
  CHECK(end_of(3.3, 10, settings) == 1050);
  CHECK(end_of(2.3, 10, settings) == 950);
  CHECK(end_of(0.1, 10, settings) == 865);   // a tenth at least
  CHECK(end_of(100, 10, settings) == 1450);  // four times as many at most
  CHECK(end_of(2.8, 20, settings) == 900);   // 1.8 s are over
  TrainSettings late = settings;
  late.pyramid = "2:0.84";
  CHECK(end_of(2.8, 10, late) == -1);
  // 25 steps and a twentieth of the schedule; with whole images throughout, a tenth.
  CHECK(TimedEnd::can_time(settings, wide_views()));
  CHECK_FALSE(TimedEnd::can_time(late, wide_views()));
  CHECK_FALSE(TimedEnd::can_time(settings_of(500, 0.15), wide_views()));
  TrainSettings whole = settings_of(300, 0.15);
  whole.pyramid.clear();
  CHECK(TimedEnd::can_time(whole, wide_views()));
  whole.log_every = 20;
  CHECK_FALSE(TimedEnd::can_time(whole, wide_views()));
}

TEST_CASE("timed end: the settings that come out repeat the run", "[budget]") {
  const test::Data data = test::synthetic("glossy", 32, 4);
  for (const auto& device : devices_under_test())
    for (const int end : {27, 41}) {
      TrainSettings settings = test::short_run(6, 30, 300);
      settings.lr_cooldown.share = 0.3;
      Trainer trainer(*device, settings, data.train, test::kNone, test::start(settings));
      const TrainSettings ending = ending_at(settings, end);
      int last = 0;
      trainer.run([&](const StepReport& report) {
        if (report.iteration == 25) trainer.end_as(ending);
        last = report.iterations;
        return true;
      });
      CHECK(last == end);
      CHECK(trainer.iteration() == end);
      Trainer again(*device, ending, data.train, test::kNone, test::start(settings));
      again.run([](const StepReport&) { return true; });
      CHECK(again.model().values == trainer.model().values);
    }
}

}  // namespace ubs
