// SPDX-License-Identifier: Apache-2.0
// Schedules that fit a time: what they contain, that they fit the costs they were made for, and that they are
// settings like any other. Times of the machine are not tested.
#include "host/train/budget.hpp"

#include <catch2/catch.hpp>
#include <filesystem>

#include "host/run/training_data.hpp"
#include "host/spec/settings.hpp"
#include "host/train/expected_time.hpp"
#include "tests/pipeline/training_runs.hpp"
#include "tests/support/device_fixture.hpp"

namespace ubs {
namespace {

using test::message_of;
using test::synthetic;

Split views_of(int side) {
  View view;
  view.camera.width = view.camera.height = side;
  return {"train", {view}};
}

// 2 ms a thousand splats and 1 ms beside on whole images, a fifth of it on the coarsest.
StepCosts some_costs() {
  return {{{{4, 9000}, 2.2, 4.2}, {{2, 18000}, 5.5, 10.5}, {{1, 30000}, 11, 21}}, 10000, 20000, 1.25, 0};
}

}  // namespace

TEST_CASE("budget: times are read", "[budget]") {
  for (const auto& [text, seconds] : {std::pair{"90", 90.0}, {"90s", 90.0}, {"1.5m", 90.0}, {"2h", 7200.0}})
    CHECK(budget_seconds(text) == seconds);
  for (const char* wrong : {"", "s", "-5s", "0", "10 min", "1d", "nan", "1e9h"})
    CHECK(message_of([&] { budget_seconds(wrong); }, ErrorKind::usage).find("90s") != std::string::npos);
}

TEST_CASE("budget: a short schedule refines as often as the published one, and grows in its first half",
          "[budget]") {
  for (const int iterations : {100, 700, 2000, 6000, 30000})
    for (const std::size_t points :
         {std::size_t{0}, std::size_t{900}, std::size_t{9262}, std::size_t{400000}}) {
      const TrainSettings s = short_schedule(short_run_settings(), iterations, points);
      INFO(iterations << " iterations, " << points << " points");
      validate(s);
      CHECK(s.iterations == iterations);
      // From random places splats go as far in few iterations as in many.
      if (points > 0) CHECK(s.lr_xyz == 1.6e-4);
      if (points == 0 && iterations >= 2000 && iterations < 20000) CHECK(s.lr_xyz * iterations == Approx(5));
      CHECK((s.lr_xyz <= 3e-3 && s.lr_xyz >= 1.6e-4));
      const double times = std::max(1.0, iterations / 2000.0);
      CHECK(s.lr_xyz_final == Approx(4e-5 * std::pow(times, -1.6)).epsilon(0.005));
      CHECK(s.lr_rgb == Approx(0.005 * std::pow(times, -0.35)).epsilon(0.005));
      CHECK(s.lr_beta == Approx(0.01 * std::pow(times, -0.6)).epsilon(0.005));
      CHECK(s.beta_dir_init == Approx(points > 0 ? -3 * std::pow(times, -1.2) : -3).epsilon(0.005));
      const std::vector<PyramidStep> levels = pyramid_steps(s);
      REQUIRE(levels.size() == 2);
      CHECK(levels[0].share == Approx(0.5 / std::sqrt(times)).epsilon(0.05));
      CHECK(levels[1].share == Approx(0.8 / std::sqrt(times)).epsilon(0.05));
      const int every = static_cast<int>(std::llround(1.0 * s.refine.step * iterations / 30000));
      CHECK(every == std::min(100, iterations / 10));
      const std::size_t initial = points > 0 ? std::min<std::size_t>(points, s.cap_max) : s.init_points;
      CHECK(splats_at(s, initial, iterations / 2) == static_cast<std::uint32_t>(s.cap_max));
      CHECK(s.cap_max == std::min(300000, std::max(10000, (points == 400000 ? 40 : 15) * iterations)));
    }
  TrainSettings chosen = short_run_settings();
  chosen.cap_max = 7000;
  chosen.growth = 1.3;
  chosen.refine.step = 900;
  chosen.init_points = 4000;
  const TrainSettings s = short_schedule(chosen, 2000, 0);
  CHECK(s.cap_max == 7000);
  CHECK(s.growth == 1.3);
  CHECK(s.refine.step == 900);
  CHECK(s.init_points == 4000);
  CHECK(short_schedule(short_run_settings(), 2000, 0, {.random_points = 700}).init_points ==
        700);  // no more than pictures can show
  // Directions of an object alone stay wide, however long.
  CHECK(short_schedule(short_run_settings(), 16000, 9000, {.lone_object = true}).beta_dir_init == -3);
  CHECK(short_schedule(short_run_settings(), 16000, 9000).beta_dir_init > -0.3);
  const std::array<double, 3> grey{0.4, 0.5, 0.6};
  CHECK(short_schedule(short_run_settings(), 2000, 9000, {.mean_colour = grey}).background.colour == grey);
  CHECK(short_schedule(short_run_settings(), 2000, 9000).opacity_reg == 0.01);
  CHECK(short_schedule(short_run_settings(), 2000, 9000, {.few_photographs = true}).opacity_reg == 0.02);
  chosen.chosen = {"opacity_reg"};
  CHECK(short_schedule(chosen, 2000, 9000, {.few_photographs = true}).opacity_reg == 0.01);
  chosen.lr_xyz = 3e-4;
  chosen.lr_rgb = 0.004;
  chosen.pyramid = "2:0.5";
  const TrainSettings longer = short_schedule(chosen, 20000, 0);
  CHECK(longer.lr_xyz == 3e-4);
  CHECK(longer.lr_rgb == 0.004);
  CHECK(longer.pyramid == "2:0.5");
}

TEST_CASE("budget: what somebody has set stays, whatever its value") {
  TrainSettings given = short_run_settings();
  given.dim = 7;
  given.variant.conditioning = Conditioning::direct;
  given.chosen = {"cap_max", "growth", "refine", "lr_xyz", "lr_cooldown", "lr_rgb", "lr_beta", "pyramid"};
  const TrainSettings s = short_schedule(given, 16000, 0),
                      free = short_schedule(short_run_settings(), 16000, 0);
  CHECK(s.cap_max == given.cap_max);
  CHECK(s.growth == given.growth);
  CHECK(s.refine == given.refine);
  CHECK(s.lr_xyz == given.lr_xyz);
  CHECK(s.lr_cooldown == given.lr_cooldown);
  CHECK(s.lr_rgb == given.lr_rgb);
  CHECK(s.lr_beta == given.lr_beta);
  CHECK(s.pyramid == given.pyramid);
  CHECK(s.lr_scale == free.lr_scale);
  CHECK(free.lr_scale < given.lr_scale);
  given.lr_cooldown.stretch = 2;
  CHECK(short_schedule(given, 16000, 0).lr_cooldown == given.lr_cooldown);
  CHECK(free.refine.step > given.refine.step);
  given.chosen = {"refine_every"};  // a key of earlier versions
  CHECK(short_schedule(given, 16000, 0).refine == given.refine);
}

TEST_CASE("budget: rates of the direct form fall sooner where things move and nobody chose", "[budget]") {
  const auto share = [](int dim, double chosen, Conditioning conditioning = Conditioning::direct) {
    TrainSettings settings = short_run_settings();
    settings.dim = dim;
    settings.variant.conditioning = conditioning;
    settings.lr_cooldown.share = chosen;
    return short_schedule(settings, 2000, 0).lr_cooldown.share;
  };
  CHECK(share(6, 0.15) == 0.15);
  CHECK(share(7, 0.15) == 0.6);
  CHECK(share(4, 0.15) == 0.6);
  CHECK(share(7, 0.3) == 0.3);
  CHECK(share(7, 0.15, Conditioning::covariance) == 0.15);
}

TEST_CASE("budget: what pictures say about a schedule", "[budget]") {
  const auto facts_of = [](bool plain, bool opaque, std::size_t views = 2) {
    View view;
    view.camera.width = view.camera.height = 10;
    view.image = {10, 10, std::vector<std::uint8_t>(300, 255)};
    view.opaque = true;
    for (int i = 0; i < 100; ++i)
      if (!plain || (i % 10 > 0 && i % 10 < 9 && i > 9 && i < 90))
        view.image.rgb[static_cast<std::size_t>(3 * i)] = static_cast<std::uint8_t>(i);
    Split train{"train", std::vector<View>(views, view)};
    train.views[1].opaque = opaque;
    return picture_facts(train, short_run_settings());
  };
  const PictureFacts photographs = facts_of(false, true);
  CHECK_FALSE(photographs.lone_object);
  REQUIRE(photographs.mean_colour);
  CHECK(*photographs.mean_colour == std::array<double, 3>{0.19, 1, 1});  // 49.5 / 255
  CHECK_FALSE(facts_of(false, false).mean_colour);
  CHECK(facts_of(true, true).lone_object);
  CHECK_FALSE(facts_of(true, true).mean_colour);
  CHECK(facts_of(false, true, 24).few_photographs);
  CHECK_FALSE(facts_of(false, true, 25).few_photographs);
  CHECK_FALSE(facts_of(true, true).few_photographs);
}

TEST_CASE("budget: the schedule takes the time that there is", "[budget]") {
  const Split train = views_of(800);
  const StepCosts costs = some_costs();
  int before = 0;
  for (const double budget : {5.0, 30.0, 90.0, 600.0, 1800.0}) {
    const BudgetRun run = fit_budget(costs, short_run_settings(), train, 9000, budget);
    INFO(budget << " s: " << run.settings.iterations << " iterations");
    CHECK(run.seconds <= budget);
    CHECK(run.seconds > 0.97 * budget);
    CHECK_FALSE(run.longest);
    CHECK(run.settings.iterations > before);
    before = run.settings.iterations;
    REQUIRE(run.curve.size() == 101);
    CHECK(run.curve.front() == 0);
    CHECK(std::ranges::is_sorted(run.curve));
    // Coarse images are cheap: the first third of the iterations takes less than a sixth of the time.
    CHECK(run.curve[30] < run.seconds / 6);
    const BudgetRun shorter = fit_budget(costs, short_run_settings(), train, 9000, budget, {}, 0.8);
    CHECK(shorter.seconds <= 0.8 * budget);
    CHECK(shorter.seconds > 0.97 * 0.8 * budget);
  }
  const BudgetRun all = fit_budget(costs, short_run_settings(), train, 9000, 1e6);
  CHECK(all.longest);
  CHECK(all.settings.iterations == 30000);
  CHECK(message_of([&] { fit_budget(costs, short_run_settings(), train, 9000, 0.01); }, ErrorKind::usage)
            .find("expected to take") != std::string::npos);
  // Independently: 100 iterations of one level at a constant number of splats.
  TrainSettings fixed = short_run_settings();
  fixed.pyramid.clear();
  fixed.cap_max = 10000;
  const TrainSettings hundred = short_schedule(fixed, 100, 10000);
  const double all_whole = expected_seconds(costs, hundred, train, 10000, 100);
  CHECK(expected_seconds(costs, hundred, train, 10000, 50) == Approx(all_whole / 2));
  CHECK(all_whole == Approx(1.25 * 100 * 11e-3));
}

TEST_CASE("budget: steps are measured on every level, and the model that training starts from is untouched",
          "[budget]") {
  const test::Data data = synthetic("glossy", 144, 4);
  for (const auto& device : devices_under_test()) {
    TrainSettings settings = short_run_settings();
    settings.dim = 3;
    const SplatModel initial = initialise_random(3, 800, 1);
    const std::vector<float> before = initial.values;
    const StepCosts costs = measure_steps(*device, settings, data.train, initial, false, 1);
    CHECK(initial.values == before);
    CHECK(costs.few == 800);
    CHECK(costs.more == 1600);
    REQUIRE(costs.levels.size() == 2);  // a quarter of 144 pixels would be too small
    CHECK(costs.levels[0].level.factor == 2);
    for (const PlanLevel& level : costs.levels) CHECK((level.start_ms > 0 && level.end_ms > 0));
    const BudgetRun run = fit_budget(costs, settings, data.train, 0, 1000);
    CHECK(run.settings.iterations > 100);
    // Whatever levels somebody asks for, a rehearsal finds its costs among those measured.
    for (const char* pyramid : {"4:0.5,2:0.8", "2:0.3", ""}) {
      settings.pyramid = pyramid;
      StepCosts own = measure_steps(*device, settings, data.train, initial, false, 1);
      settings.cap_max = 2000;
      const BudgetRun some = fit_budget(own, settings, data.train, 0, 1e4);  // also on a busy machine
      own.over_pilot = 0;
      rehearse_budget(*device, rehearsal(some, settings, 0, 1e9), data.train, initial, own);
      INFO(pyramid << ": " << own.over_pilot);
      CHECK(own.over_pilot > 0.2);
      CHECK(own.over_pilot < 20);
      CHECK(initial.values == before);
    }
  }
}

TEST_CASE("budget: a rehearsal grows to as many splats, with growth and interval that somebody chose",
          "[budget]") {
  TrainSettings base = short_run_settings();
  base.cap_max = 5000;
  base.init_points = 1000;
  BudgetRun run{short_schedule(base, 4000, 0), 0, {}, false};
  const TrainSettings chosen = rehearsal(run, base, 0, 60);
  CHECK(chosen.iterations == 400);
  CHECK(chosen.cap_max == 5000);
  CHECK(chosen.growth > run.settings.growth);  // fewer refinements
  CHECK(splats_at(chosen, 1000, chosen.iterations) == 5000);
  base.growth = 1.5;
  base.refine.step = 700;
  run.settings = short_schedule(base, 4000, 0);
  const TrainSettings own = rehearsal(run, base, 0, 60);
  CHECK(own.growth == 1.5);
  CHECK(own.refine.step == 700);
  CHECK(own.pyramid == chosen.pyramid);  // not what 4000 iterations have
  CHECK(own.lr_rgb == base.lr_rgb);
  base.pyramid = run.settings.pyramid = "2:0.5";
  CHECK(rehearsal(run, base, 0, 60).pyramid == "2:0.5");
  base.batch = run.settings.batch = 2;
  CHECK(rehearsal(run, base, 0, 1e9).iterations == 200);  // as many views
  base.batch = run.settings.batch = 40;
  CHECK(rehearsal(run, base, 0, 1e9).iterations == 100);
  // Also where a long run comes to the usual most splats.
  run.settings = short_schedule(short_run_settings(), 25000, 9000);
  REQUIRE(run.settings.cap_max == TrainSettings{}.cap_max);
  const TrainSettings most = rehearsal(run, short_run_settings(), 9000, 900);
  CHECK(most.cap_max == run.settings.cap_max);
  CHECK(splats_at(most, 9000, most.iterations) == static_cast<std::uint32_t>(run.settings.cap_max));
}

TEST_CASE("budget: at the end of a short schedule the rates fall to zero", "[budget]") {
  const test::Data data = synthetic("glossy", 32, 4);
  for (const auto& device : devices_under_test()) {
    const auto after = [&](double cooldown, int iterations) {
      TrainSettings settings = test::short_run(6, 20, 300);
      settings.lr_cooldown.share = cooldown;
      Trainer trainer(*device, settings, data.train, {"test", {}}, initialise_random(6, 300, settings.seed));
      trainer.run([&](const StepReport& report) { return report.iteration < iterations; });
      REQUIRE(trainer.iteration() == iterations);
      return trainer.model().values;
    };
    CHECK(after(0.5, 10) == after(0, 10));
    CHECK(after(0.5, 11) != after(0, 11));
    CHECK(after(0.5, 20) == after(0.5, 19));  // the last rate is 0
    CHECK(after(0, 20) != after(0, 19));
  }
}

TEST_CASE("budget: durations as people say them", "[budget]") {
  for (const auto& [seconds, text] : {std::pair{0.04, "0.0 s"},
                                      {4.24, "4.2 s"},
                                      {48.2, "48 s"},
                                      {59.6, "1 min 0 s"},
                                      {365, "6 min 5 s"},
                                      {2100, "35 min"},
                                      {3599, "1 h 0 min"},
                                      {8220, "2 h 17 min"},
                                      {360000, "100 h 0 min"}})
    CHECK(duration_text(seconds) == text);
  CHECK(interval_text(48, 0.75, 2.2) == "48 s (36 s to 1 min 46 s)");
}

TEST_CASE("budget: what is left of a run knows where its time goes", "[budget]") {
  const std::vector<double> curve{0, 1, 2, 12};  // the last third takes ten times as long
  CHECK(remaining_seconds(curve, 0, 1) == 12);
  CHECK(remaining_seconds(curve, 0.5, 1) == Approx(10.5));
  CHECK(remaining_seconds(curve, 0.5, 2) == Approx(21));
  CHECK(remaining_seconds(curve, 5.0 / 6, 1) == Approx(5));
  CHECK(remaining_seconds(curve, 1, 3) == 0);
  CHECK(remaining_seconds({}, 0.5, 1) == 0);
  // Without a plan (--no-plan, --resume) growth and coarse images are known all the same: the second half of
  // a run that grows to 30 times its splats takes most of its time.
  TrainSettings growing;
  growing.iterations = 3000;
  const std::vector<double> assumed = assumed_curve(growing, 10000);
  REQUIRE(assumed.size() == 101);
  CHECK(assumed[50] < 0.35 * assumed[100]);
  growing.pyramid = "4:0.5";
  growing.cap_max = 10000;
  const std::vector<double> coarse = assumed_curve(growing, 10000);
  CHECK(coarse[50] / coarse[100] == Approx(0.1 / 1.1));
}

TEST_CASE(
    "data_specs: published.yaml is the defaults but for the first splats and conditioning, fast.yaml what "
    "a budget starts from",
    "[budget]") {
  const auto text_of = [](TrainSettings settings, std::string_view without) {
    std::string text;
    for (const FieldValue& field : bind_fields(settings, train_fields()))
      if (std::string_view(field.key) != without)
        text += fmt::format("{}={}\n", field.key, field_text(field));
    return text;
  };
  const std::filesystem::path folder = std::filesystem::path(UBS_SOURCE_DIR) / "data_specs";
  TrainSettings published = short_run_settings(), fast;
  load_yaml(bind_fields(published, train_fields()), folder / "published.yaml");
  TrainSettings standard;
  standard.init_points = 100000;
  standard.init_extent = 1.3;
  standard.conditioning_auto = false;
  CHECK(text_of(published, "") == text_of(standard, ""));
  load_yaml(bind_fields(fast, train_fields()), folder / "fast.yaml");
  CHECK(text_of(fast, "growth") == text_of(short_schedule(short_run_settings(), 2000, 9000), "growth"));
  CHECK(splats_at(fast, 9000, fast.iterations / 2) == 30000);
}

}  // namespace ubs
