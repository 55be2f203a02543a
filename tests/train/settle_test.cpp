// SPDX-License-Identifier: Apache-2.0
// Tests the function that decides automatic settings: a table of requests, facts about the data, and the
// values that follow. Also tests how the facts are determined, and the setting lr_cooldown.
#include "host/settings/settle.hpp"

#include <catch2/catch.hpp>
#include <filesystem>
#include <sstream>

#include "host/run/facts_of.hpp"
#include "host/settings/fields.hpp"
#include "host/settings/schedule.hpp"
#include "tests/pipeline/training_runs.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs {
namespace {

// Facts about photographs of a static scene with points.
Facts photographs() {
  Facts facts;
  facts.views = 100;
  facts.pixels = 5e5;
  facts.dim = {6, "because"};
  facts.depth = 4;
  facts.points = 9000;
  facts.transparent = "";
  facts.mean_colour = {0.5, 0.25, 1};
  return facts;
}

Facts with(void (*change)(Facts&)) {
  Facts facts = photographs();
  change(facts);
  return facts;
}

// A request as a list of assignments, separated by blanks.
TrainSettings request(const std::string& assignments) {
  TrainSettings settings;
  std::istringstream words(assignments);
  for (std::string word; words >> word;)
    settings.chosen.insert(set_field(bind_fields(settings, train_fields()), word, "request"));
  return settings;
}

std::string value(TrainSettings settings, std::string_view key) {
  for (const FieldValue& field : bind_fields(settings, train_fields()))
    if (field.key == key) return field_text(field);
  return "unknown key";
}

struct Row {
  const char *asked, *expected;
  Facts facts = photographs();
};

const Facts kMoving = with([](Facts& f) { f.moves = true, f.dim.dim = 7, f.points = 0; });
const Facts kNoPoints = with([](Facts& f) { f.points = 0, f.random_points = 700; });

const Row kRows[] = {
    // The length, and what depends on it.
    {"", "schedule=fast iterations=16000 cap_max=192000 budget=none"},
    {"schedule=published",
     "iterations=30000 cap_max=300000 refine=500:25000:100 growth=1.02 pyramid= noise_lr=16000000"},
    {"iterations=2000",
     "cap_max=24000 pyramid=4:0.5,2:0.8 refine=500:25000:1500 lr_rgb=0.005 lr_cooldown=0.15"},
    {"iterations=2000 schedule=published",
     "cap_max=300000 pyramid= refine=500:25000:100 lr_rgb=0.001 lr_cooldown=0"},
    {"budget=10m", "iterations=16000 budget=none"},
    {"iterations=400", "cap_max=10000 refine=500:25000:3000"},
    {"iterations=30000", "cap_max=300000"},
    {"iterations=8000", "pyramid=4:0.25,2:0.47", with([](Facts& f) { f.pixels = 2e6; })},
    {"iterations=2000", "pyramid=4:0.5,2:0.95", with([](Facts& f) { f.pixels = 2e6; })},
    {"iterations=390", "pyramid=4:0.7,2:0.95"},
    {"iterations=2000", "cap_max=80000", with([](Facts& f) { f.points = 400000; })},
    // What was asked for is kept.
    {"cap_max=7000 growth=1.3 refine=500:25000:900 init_points=4000 lr_rgb=0.004 pyramid=2:0.5 "
     "opacity_reg=0.03",
     "cap_max=7000 growth=1.3 refine=500:25000:900 init_points=4000 lr_rgb=0.004 pyramid=2:0.5 "
     "opacity_reg=0.03 "
     "find_points=0"},
    {"cap_max=300000 iterations=2000", "cap_max=300000"},
    // Initial splats.
    {"iterations=2000", "init_points=700 lr_xyz=0.0025 beta_dir_init=-3", kNoPoints},
    {"iterations=2000", "init_points=100000 lr_xyz=0.00016 beta_dir_init=-3 find_points=75000"},
    {"iterations=20000 init_extent=2", "init_extent=2 find_points=0"},
    {"iterations=16000", "beta_dir_init=-0.247"},
    {"iterations=16000", "beta_dir_init=-3", with([](Facts& f) { f.plain_background = true; })},
    {"budget=20s", "find_points=20000"},
    // Dimensions and units.
    {"", "dim=6 conditioning=covariance unit=4 noise_lr=1000000 near_plane=0.04"},
    {"unit=1 schedule=published", "noise_lr=1000000 unit=1"},
    // Copies.
    {"", "copy_spread=0.35"},
    {"", "copy_spread=0.35", kMoving},
    {"schedule=published", "copy_spread=0"},
    {"freeze=scale", "copy_spread=0"},
    {"copy_spread=0.5 schedule=published", "copy_spread=0.5"},
    {"cov_param=skew_nd", "unit=1"},
    {"", "dim=7 conditioning=direct noise_lr=1 find_points=0 lr_cooldown=0.6", kMoving},
    {"conditioning=covariance", "conditioning=covariance lr_cooldown=0.15", kMoving},
    {"dim=7", "conditioning=covariance", kMoving},
    // The kernel and the colours.
    {"schedule=published", "lr_opacity=0.05 lr_scale=0.005"},
    {"schedule=published dim=7", "beta_dir_init=-3"},
    {"schedule=published kernel=gaussian colour=sb1", "lr_opacity=0.025 lr_scale=0.02 lr_rgb=0.0025"},
    // The background, and the penalty of opacities.
    {"", "background=0.5,0.25,1 random_background=on opacity_reg=0"},
    {"", "background=0,0,0 random_background=off opacity_reg=0.01",
     with([](Facts& f) { f.transparent = "a"; })},
    {"background=1,1,1", "background=1,1,1 random_background=on"},
    {"background=learn", "background=learn random_background=off opacity_reg=0.01"},
    {"", "opacity_reg=0.02", with([](Facts& f) { f.few_images = true; })},
    {"schedule=published", "opacity_reg=0", with([](Facts& f) { f.wide_images = true; })},
};

}  // namespace

TEST_CASE("settle: requests and facts determine the plan", "[schedule]") {
  for (const Row& row : kRows) {
    const Plan plan = settle(request(row.asked), row.facts).plan;
    std::istringstream words(row.expected);
    for (std::string word; words >> word;) {
      const std::size_t equals = word.find('=');
      INFO("asked: " << row.asked << "; " << word);
      CHECK(value(plan.recorded(), word.substr(0, equals)) == word.substr(equals + 1));
    }
    // The recorded settings repeat the run: they are complete, and settling them again changes nothing.
    CHECK(changed_keys(plan.recorded(), settle(plan.recorded(), row.facts).plan.recorded()).empty());
    CHECK(plan.settings().unit == 1);
    CHECK(plan.settings().near_plane == Approx(plan.recorded().near_plane / plan.unit()));
  }
}

TEST_CASE("settle: splats are added in the first half of a run with the schedule fast", "[schedule]") {
  for (const int iterations : {100, 700, 2000, 6000, 30000})
    for (const std::size_t points : {0, 900, 9262, 400000}) {
      TrainSettings asked;
      asked.iterations = iterations;
      Facts facts = photographs();
      facts.points = points;
      const TrainSettings s = settle(asked, facts).plan.settings();
      INFO(iterations << " iterations, " << points << " points");
      CHECK(Schedule(s, first_splats(s, facts)).splats_at(0.5) == static_cast<std::uint32_t>(s.cap_max));
    }
}

TEST_CASE("settle: a plan is complete, and its length can change", "[schedule]") {
  CHECK_THROWS_WITH(Plan(TrainSettings{}), Catch::Contains("automatic"));
  CHECK_THROWS_WITH(settle(TrainSettings{}), Catch::Contains("dim = auto requires data"));
  Plan plan = settle(request("unit=20 near_plane=0.2 far_plane=400 init_extent=30"), photographs()).plan;
  CHECK(std::array{plan.settings().near_plane, plan.settings().far_plane, plan.settings().init_extent} ==
        std::array{0.01, 20.0, 1.5});
  CHECK(std::array{plan.recorded().unit, plan.recorded().near_plane} == std::array{20.0, 0.2});
  TrainSettings shorter = plan.settings();
  shorter.iterations = 500;
  plan.set_length(shorter);
  CHECK(plan.recorded().iterations == 500);
  CHECK(plan.settings().near_plane == 0.01);
}

TEST_CASE("settle: settings that do not suit the data are refused, or give a warning", "[schedule]") {
  const Facts transparent = with([](Facts& f) { f.transparent = "a.png"; });
  for (const char* asked : {"background=learn", "background=sky", "random_background=on"})
    CHECK(test::message_of([&] { settle(request(asked), transparent); }, ErrorKind::data)
              .starts_with("a.png: the image may be transparent"));
  CHECK(
      test::message_of([&] { settle(request("cov_param=skew_nd unit=2"), photographs()); }, ErrorKind::usage)
          .find("unit = 1") != std::string::npos);
  CHECK(settle(request("dim=7"), photographs()).warnings.at(0).find("cannot learn motion") !=
        std::string::npos);
  CHECK(settle(request("dim=3"), kMoving).warnings.at(0).find("--dim 4") != std::string::npos);
  CHECK(settle(request(""), photographs()).warnings.empty());
}

TEST_CASE("settings: a budget excludes a number of iterations", "[schedule]") {
  CHECK(budget_seconds(request("")) == 900);
  CHECK(budget_seconds(request("iterations=100")) == 0);
  CHECK(budget_seconds(request("schedule=published")) == 0);
  CHECK(budget_seconds(request("budget=2m schedule=published")) == 120);
  CHECK_THROWS_WITH(validate(request("budget=2m iterations=100")), Catch::Contains("remove --budget"));
  CHECK_THROWS_WITH(validate(request("budget=0.1s")), Catch::Contains("increase the budget"));
  CHECK_THROWS_WITH(validate(request("budget=+2m")), Catch::Contains("resumed"));
}

TEST_CASE("facts: single objects and small numbers of photographs are recognised", "[schedule]") {
  const auto found = [](bool plain, bool opaque, std::size_t views = 2) {
    View view;
    view.camera.width = view.camera.height = 10;
    view.camera.fx = view.camera.fy = 10;
    view.image = {10, 10, std::vector<std::uint8_t>(300, 255)};
    view.opaque = true;
    for (int i = 0; i < 100; ++i)
      if (!plain || (i % 10 > 0 && i % 10 < 9 && i > 9 && i < 90))
        view.image.rgb[static_cast<std::size_t>(3 * i)] = static_cast<std::uint8_t>(i);
    Split train{"train", std::vector<View>(views, view)};
    train.views[1].opaque = opaque;
    train.views[1].name = "second";
    Dataset data;
    return facts_of(data, train, request("find_points=0"));
  };
  CHECK_FALSE(found(false, true).plain_background);
  CHECK(found(true, true).plain_background);
  CHECK(found(false, true, 24).few_images);
  CHECK_FALSE(found(false, true, 25).few_images);
  CHECK_FALSE(found(true, true).few_images);
  CHECK(found(true, true).mean_colour[1] == 1);
  CHECK(found(true, false).transparent == "second");
  CHECK(found(true, true).random_points == 100);
  CHECK(found(true, true).one_place);
}

TEST_CASE("settings: with lr_cooldown, learning rates fall to zero at the end", "[schedule]") {
  const test::Data data = synthetic("glossy", 32, 4);
  for (const auto& device : devices_under_test()) {
    const auto after = [&](double cooldown, int iterations) {
      TrainSettings settings = test::short_run(6, 20, 300);
      settings.lr_cooldown = cooldown;
      Trainer trainer(*device, settle(settings), data.train, {"test", {}},
                      initialise_random(6, 300, settings.seed));
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

TEST_CASE("data_specs: published.yaml contains the published values", "[schedule]") {
  TrainSettings spec;
  spec.dim = 6;
  load_yaml(bind_fields(spec, train_fields()),
            std::filesystem::path(UBS_SOURCE_DIR) / "data_specs/published.yaml");
  TrainSettings published;
  published.dim = 6;
  published.schedule = ScheduleKind::published;
  published.init_extent = 1.3;
  published.unit = 1;
  published.conditioning_auto = false;
  published.find_points = 0;
  published.background = {};
  published.random_background = RandomBackground::off;
  CHECK(changed_keys(settle(spec).recorded(), settle(published).recorded()).empty());
}

}  // namespace ubs
