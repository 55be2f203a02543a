// SPDX-License-Identifier: Apache-2.0
// Tests WorkShare, which computes the share of the schedule that is completed after an iteration. This share
// is proportional to the number of iterations, or is interpolated between the points of the setting
// work_shares. Refinements, learning rates and all other parts of the schedule depend on it.
#include "host/settings/work_share.hpp"

#include <algorithm>
#include <catch2/catch.hpp>
#include <random>

#include "host/settings/fields.hpp"
#include "host/settings/schedule.hpp"
#include "host/train/pyramid.hpp"
#include "host/train/run_settings.hpp"
#include "host/train/time_budget.hpp"
#include "tests/support/published.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs {
namespace {

using test::message_of;

TrainSettings settings_of(int iterations, const std::string& shares = {}) {
  TrainSettings s = test::published();
  s.iterations = iterations;
  s.work_shares = shares;
  s.lr_cooldown = 0.15;
  s.pyramid = "4:0.5,2:0.8";
  return settle(s).settings();
}

// Returns settings with up to `points` random points in work_shares.
TrainSettings random_course(std::mt19937& random, int points) {
  std::uniform_int_distribution<int> apart(1, 60);
  std::uniform_real_distribution<double> step(0.001, std::min(0.9, 1.8 / points));
  std::vector<SharePoint> course;
  SharePoint at;
  for (int k = 0; k < points; ++k) {
    at = {at.iteration + apart(random), at.share + step(random)};
    if (at.share >= 1) break;
    course.push_back(at);
  }
  const int end = course.back().iteration + apart(random);
  course.push_back({end, 1});
  return settings_of(end, to_string(course));
}

std::vector<PyramidLevel> levels_of(const TrainSettings& settings) {
  View view;
  view.camera.width = view.camera.height = 512;
  return pyramid_levels(settings, {"train", {view}});
}

}  // namespace

TEST_CASE("work share: a continued run repeats the last part of its schedule", "[schedule]") {
  // In the first case, the run had a time budget. In the second case, its number of iterations was chosen
  // when it started.
  for (const auto& [asked, ended] : {std::pair{"60:0.5,100:1", "60:0.5,100:1"}, {"", "100:1"}}) {
    INFO(ended);
    const TrainSettings longer = settings_of(200, ended + std::string(",101:0.85,150:0.9"));
    const WorkShare before(settings_of(100, asked)), work(longer);
    CHECK(work.steps() == before.steps());
    for (int i = 1; i <= 100; ++i) {
      CHECK(work.at(i) == before.at(i));
      CHECK(work.steps_at(i) == before.steps_at(i));
    }
    CHECK(work.at(101) == 0.85);
    CHECK(work.at(150) == 0.9);
    CHECK(work.at(200) == 1);
    for (const double share : {0.3, 0.5, 0.85, 0.95, 1.0})
      CHECK(work.iteration_at(share * work.steps()) == before.iteration_at(share * before.steps()));
    CHECK(work.iterations_per_share(101) == Approx(49 / 0.05));  // from iteration 101 to 150
    const Schedule schedule(longer, 1000);
    for (int i = 101; i <= 200; ++i) CHECK_FALSE(schedule.refines(i));
  }

  CHECK_THAT(message_of([] { WorkShare(settings_of(200, "60:0.5,100:0.4")); }, ErrorKind::usage),
             Catch::Contains("the entry after '60:0.5' is invalid"));
}

TEST_CASE("work share: without points, the share is proportional to the iterations", "[schedule]") {
  for (const int iterations : {1, 7, 1000, 16001, 30000}) {
    const TrainSettings settings = settings_of(iterations);
    const WorkShare work(settings);
    const Schedule schedule(settings, 1000);
    const auto scaled = [&](int i) { return std::llround(static_cast<double>(i) * iterations / 30000); };
    const int every = static_cast<int>(std::max(1ll, scaled(100)));
    CHECK(work.steps() == iterations);
    for (int i = 1; i <= iterations; ++i) {
      CHECK(work.at(i) == static_cast<double>(i) / iterations);
      const bool refines = i > scaled(500) && i < scaled(25000) && i % every == 0;
      REQUIRE(schedule.refines(i) == refines);
    }
    for (const double share : {0.1, 0.5, 0.85, 1.0})
      CHECK(work.iteration_at(share * iterations) == std::llround(share * iterations));
    CHECK(work.iterations_per_share(1) == iterations);
  }
}

TEST_CASE("work share: the share is linear between points, and 1 at the end of the run", "[schedule]") {
  const TrainSettings settings = settings_of(400, "100:0.5,200:0.6");
  const WorkShare work(settings);
  CHECK(work.at(0) == 0);
  CHECK(work.at(50) == Approx(0.25));
  CHECK(work.at(100) == 0.5);
  CHECK(work.at(150) == Approx(0.55));
  CHECK(work.at(300) == Approx(0.8));
  CHECK(work.at(400) == 1);
  CHECK(work.iteration_at(0.25 * work.steps()) == 50);
  CHECK(work.iteration_at(0.5 * work.steps()) == 100);
  CHECK(work.iteration_at(0.8 * work.steps()) == 300);
  CHECK(work.iterations_per_share(100) == Approx(200));
  CHECK(work.iterations_per_share(101) == Approx(1000));
  CHECK(work.last().iteration == 200);
  // Settings in iterations of the published schedule, which has 30 000, are converted to shares of the work.
  const Schedule schedule(settings, 1000);
  CHECK_FALSE(schedule.regularises(3));
  CHECK(schedule.regularises(4));  // iteration 500 of 30 000 is iteration 3.3 here
  const ParameterLayout layout(6);
  const Schedule plain(settings_of(1000), 1000);
  for (const int i : {50, 100, 150, 300, 390})
    CHECK(schedule.learning_rates(layout, i)[0] ==
          Approx(plain.learning_rates(layout, static_cast<int>(std::lround(1000 * work.at(i))))[0]));
  CHECK(schedule.learning_rates(layout, 400)[0] == 0);
}

TEST_CASE("work share: later points do not change earlier iterations", "[schedule]") {
  std::mt19937 random(1);
  for (int run = 0; run < 200; ++run) {
    const TrainSettings settings = random_course(random, 1 + run % 12);
    validate(settings);
    const std::vector<SharePoint> course = share_points(settings);
    const Schedule whole(settings, 1000);
    const std::vector<PyramidLevel> levels = levels_of(settings);
    INFO(settings.work_shares);
    for (std::size_t known = 1; known < course.size(); ++known) {
      // `part` is the schedule at the time when only the first `known` points were known, and the run was
      // expected to end at another iteration.
      const int until = course[known - 1].iteration;
      const TrainSettings then = settings_of(
          until + 1 + run % 90, to_string({course.begin(), course.begin() + static_cast<long>(known)}));
      const Schedule part(then, 1000);
      for (int i = 1; i <= until; ++i) {
        REQUIRE(part.work().at(i) == whole.work().at(i));
        REQUIRE(part.refines(i) == whole.refines(i));
        REQUIRE(part.regularises(i) == whole.regularises(i));
        REQUIRE(part.camera_sweep(i) == whole.camera_sweep(i));
        REQUIRE(part.noise(i) == whole.noise(i));
        REQUIRE(factor_at(levels, part.work(), i) == factor_at(levels, whole.work(), i));
      }
    }
  }
}

TEST_CASE("work share: changing the schedule between two points does not change earlier iterations",
          "[schedule]") {
  std::mt19937 random(3);
  int tested = 0;
  for (int run = 0; run < 300; ++run) {
    // Every third run has no points, because its number of iterations was chosen when it started.
    const TrainSettings before = run % 3 == 0
                                     ? settings_of(std::uniform_int_distribution<int>(2, 2000)(random))
                                     : random_course(random, 1 + run % 12);
    INFO(before.iterations << " iterations " << before.work_shares);
    const int at = std::uniform_int_distribution<int>(1, before.iterations - 1)(random);
    TrainSettings after = before;
    std::vector<SharePoint> course = share_points(before);
    after.work_shares = shares_until(before, at);
    validate(after);
    CHECK(WorkShare(after).last().iteration == at);
    CHECK(WorkShare(after).last().share == WorkShare(before).at(at));
    CHECK(shares_until(after, at) == after.work_shares);
    // The rest of the work is done with another speed. If `run` is even, the share first jumps ahead.
    course = share_points(after);
    const double share = WorkShare(before).at(at), rest = 1 - share;
    if (run % 2 == 0) course.push_back({at + 1, share + 0.7 * rest});
    course.push_back({at + 2 + run % 40, share + 0.8 * rest});
    after.iterations = at + 2 + run;
    if (after.iterations <= course.back().iteration) course.pop_back();
    course.push_back({after.iterations, 1});
    after.work_shares = to_string(course);
    validate(after);
    INFO(after.work_shares);
    const Schedule then(before, 1000), now(after, 1000);
    const std::vector<PyramidLevel> levels = levels_of(before);
    for (int i = 1; i <= at; ++i) {
      REQUIRE(then.work().at(i) == now.work().at(i));
      REQUIRE(then.refines(i) == now.refines(i));
      REQUIRE(then.regularises(i) == now.regularises(i));
      REQUIRE(then.camera_sweep(i) == now.camera_sweep(i));
      REQUIRE(then.noise(i) == now.noise(i));
      REQUIRE(factor_at(levels, then.work(), i) == factor_at(levels, now.work(), i));
      ++tested;
    }
    for (int i = at; i < after.iterations; ++i) REQUIRE(now.work().at(i) < now.work().at(i + 1));
    CHECK(now.work().at(after.iterations) == 1);
    // The schedule can be changed again at a later iteration.
    const int again = std::max(at + 1, after.iterations - 1);
    CHECK(shares_until(after, again).starts_with(shares_until(before, at) + ","));
  }
  CHECK(tested > 1000);
}

TEST_CASE("work share: a run with points has all refinements, camera refinements and splats of the schedule",
          "[schedule]") {
  std::mt19937 random(2);
  TrainSettings settings = random_course(random, 12);
  std::vector<SharePoint> course = share_points(settings);
  for (SharePoint& point : course) point.iteration *= 40;  // many iterations between refinements
  settings.iterations *= 40;
  settings.work_shares = to_string(course);
  settings.refine.step = 1000;
  settings.growth = 1.1;
  const Schedule schedule(settings, 1000);
  int refinements = 0, sweeps = 0;
  std::uint32_t splats = 1000;
  for (int i = 1; i <= settings.iterations; ++i) {
    sweeps += schedule.camera_sweep(i).has_value();
    if (!schedule.refines(i)) continue;
    ++refinements;
    splats = schedule.grown(splats, i);
    CHECK(schedule.splats_at(schedule.work().at(i) + 1e-4) == splats);
  }
  CHECK(refinements == 24);  // every 1000 of the 30 000 published iterations, after 500 and before 25 000
  CHECK(sweeps == 20);
  CHECK(splats == schedule.splats_at(1));
  // With growth_end = 0.5, no splats are added after half of the work.
  TrainSettings stopped = settings;
  stopped.growth_end = 0.5;
  const Schedule half(stopped, 1000);
  CHECK(half.splats_at(1) == schedule.splats_at(0.4999));
  const int behind = half.work().iteration_at(0.51 * half.work().steps());
  CHECK(half.grown(1000, behind) == 1000);
  CHECK(schedule.grown(1000, behind) == 1100);
}

TEST_CASE("work share: invalid points are rejected", "[schedule]") {
  for (const char* wrong : {"5", "5:", ":0.5", "5:0.5,", "5:0.5,5:0.6", "5:0.5,6:0.5", "5:1.5", "5:nan",
                            "-5:0.5", "5:0", "5:0.5;6:0.6", "5:0.5@", "5:0.5@0", "5:0.5@5", "5:0.5@9",
                            "5:0.5@2,2:0.6", "5:0.5@2,6:0.1", "5@2:0.5", "5:0.5,9:0.6@4"})
    CHECK(message_of([&] { validate(settings_of(100, wrong)); }, ErrorKind::usage)
              .find("work_shares must be") != std::string::npos);
  for (const char* wrong : {"50:0.5,101:0.6", "50:0.5,99:1", "100:0.5"})
    CHECK(message_of([&] { validate(settings_of(100, wrong)); }, ErrorKind::usage)
              .find("does not match iterations") != std::string::npos);
  validate(settings_of(100, "50:0.5,100:1"));
  validate(settings_of(100, "50:0.5@20,21:0.4,100:1"));
}

}  // namespace ubs
