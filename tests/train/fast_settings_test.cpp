// SPDX-License-Identifier: Apache-2.0
// Tests the settings that ubs chooses for short runs: how their values depend on the number of iterations and
// on the images, and whether data_specs/fast.yaml contains them. Also tests the default background of opaque
// images, and the setting lr_cooldown.
#include "host/train/fast_settings.hpp"

#include <catch2/catch.hpp>
#include <filesystem>

#include "host/api/training_data.hpp"
#include "host/scene/settings.hpp"
#include "host/train/schedule.hpp"
#include "tests/pipeline/training_runs.hpp"
#include "tests/support/device_fixture.hpp"

namespace ubs {

TEST_CASE("fast settings: values scale with the iterations, and splats are added in the first half",
          "[schedule]") {
  for (const int iterations : {100, 700, 2000, 6000, 30000})
    for (const std::size_t points :
         {std::size_t{0}, std::size_t{900}, std::size_t{9262}, std::size_t{400000}}) {
      const TrainSettings s = fast_settings_for(fast_settings(), iterations, points);
      INFO(iterations << " iterations, " << points << " points");
      validate(s);
      CHECK(s.iterations == iterations);
      // Without initial points, splats start at random positions and must move as far in few iterations as in
      // many.
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
      CHECK(Schedule(s, initial).splats_at(0.5) == static_cast<std::uint32_t>(s.cap_max));
      CHECK(s.cap_max == std::min(300000, std::max(10000, (points == 400000 ? 40 : 12) * iterations)));
    }
  TrainSettings chosen = fast_settings();
  chosen.cap_max = 7000;
  chosen.growth = 1.3;
  chosen.refine.step = 900;
  chosen.init_points = 4000;
  const TrainSettings s = fast_settings_for(chosen, 2000, 0);
  CHECK(s.cap_max == 7000);
  CHECK(s.growth == 1.3);
  CHECK(s.refine.step == 900);
  CHECK(s.init_points == 4000);
  // The number of random initial splats is limited for images with few pixels.
  CHECK(fast_settings_for(fast_settings(), 2000, 0, {.random_points = 700}).init_points == 700);
  // If the images show a single object, the initial direction betas are -3 for runs of any length.
  CHECK(fast_settings_for(fast_settings(), 16000, 9000, {.lone_object = true}).beta_dir_init == -3);
  CHECK(fast_settings_for(fast_settings(), 16000, 9000).beta_dir_init > -0.3);
  CHECK(fast_settings_for(fast_settings(), 2000, 9000).opacity_reg == 0.01);
  CHECK(fast_settings_for(fast_settings(), 2000, 9000, {.few_photographs = true}).opacity_reg == 0.02);
  CHECK(fast_settings_for(fast_settings(), 2000, 9000, {.wide_images = true}).opacity_reg == 0);
  TrainSettings opaque = fast_settings();
  opaque.random_background = RandomBackground::on;
  CHECK(fast_settings_for(opaque, 2000, 9000).opacity_reg == 0);
  CHECK(fast_settings_for(opaque, 2000, 9000, {.few_photographs = true}).opacity_reg == 0.02);
  // If images are large, the second level of the image pyramid ends later. If each image is used only a few
  // times, both levels end later. Then fewer iterations use images of full size.
  const auto pyramid = [](int iterations, std::size_t views, double pixels) {
    return fast_settings_for(fast_settings(), iterations, 9000, {.views = views, .pixels = pixels}).pyramid;
  };
  CHECK(pyramid(2000, 100, 5e5) == "4:0.5,2:0.8");
  CHECK(pyramid(2000, 100, 2e6) == "4:0.5,2:0.95");
  CHECK(pyramid(390, 100, 5e5) == "4:0.7,2:0.95");
  CHECK(pyramid(8000, 100, 2e6) == "4:0.25,2:0.47");
  chosen.chosen = {"opacity_reg"};
  CHECK(fast_settings_for(chosen, 2000, 9000, {.wide_images = true}).opacity_reg == 0.01);
  CHECK(fast_settings_for(chosen, 2000, 9000, {.few_photographs = true}).opacity_reg == 0.01);
  chosen.lr_xyz = 3e-4;
  chosen.lr_rgb = 0.004;
  chosen.pyramid = "2:0.5";
  const TrainSettings longer = fast_settings_for(chosen, 20000, 0);
  CHECK(longer.lr_xyz == 3e-4);
  CHECK(longer.lr_rgb == 0.004);
  CHECK(longer.pyramid == "2:0.5");
}

TEST_CASE("fast settings: values chosen by the user are kept") {
  TrainSettings given = fast_settings();
  given.dim = 7;
  given.variant.conditioning = Conditioning::direct;
  given.chosen = {"cap_max", "growth", "refine", "lr_xyz", "lr_cooldown", "lr_rgb", "lr_beta", "pyramid"};
  const TrainSettings s = fast_settings_for(given, 16000, 0),
                      free = fast_settings_for(fast_settings(), 16000, 0);
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
  CHECK(free.refine.step > given.refine.step);
}

TEST_CASE("fast settings: with direct conditioning, learning rates of dynamic scenes fall earlier",
          "[schedule]") {
  const auto share = [](int dim, double chosen, Conditioning conditioning = Conditioning::direct) {
    TrainSettings settings = fast_settings();
    settings.dim = dim;
    settings.variant.conditioning = conditioning;
    settings.lr_cooldown = chosen;
    return fast_settings_for(settings, 2000, 0).lr_cooldown;
  };
  CHECK(share(6, 0.15) == 0.15);
  CHECK(share(7, 0.15) == 0.6);
  CHECK(share(4, 0.15) == 0.6);
  CHECK(share(7, 0.3) == 0.3);
  CHECK(share(7, 0.15, Conditioning::covariance) == 0.15);
  CHECK(fast_run_splats(2000, 0) == 24000);  // 12 splats per iteration, for all kinds of conditioning
}

TEST_CASE("fast settings: single objects and small numbers of photographs are recognised", "[schedule]") {
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
    return picture_facts(train, fast_settings());
  };
  const PictureFacts photographs = facts_of(false, true);
  CHECK_FALSE(photographs.lone_object);
  CHECK(facts_of(true, true).lone_object);
  CHECK(facts_of(false, true, 24).few_photographs);
  CHECK_FALSE(facts_of(false, true, 25).few_photographs);
  CHECK_FALSE(facts_of(true, true).few_photographs);
}

TEST_CASE("background: for opaque images, the default is the mean colour with random changes", "[schedule]") {
  const auto settled = [](TrainSettings settings, bool opaque) {
    View view;
    view.camera.width = view.camera.height = 10;
    view.camera.fx = view.camera.fy = 10;
    view.image = {10, 10, std::vector<std::uint8_t>(300, 255)};
    for (std::size_t i = 0; i < 50; ++i) view.image.rgb[3 * i] = 0;
    view.opaque = true;
    Split train{"train", {view, view}};
    train.views[1].opaque = opaque;
    Dataset data;
    settle_training(train, data, settings);
    return settings;
  };
  TrainSettings settings;
  const TrainSettings photographs = settled(settings, true);
  CHECK(photographs.random_background == RandomBackground::on);
  CHECK(photographs.background.colour == std::array<double, 3>{0.5, 1, 1});  // the mean colour of the images
  const TrainSettings transparent = settled(settings, false);
  CHECK(transparent.random_background == RandomBackground::off);
  CHECK(transparent.background == Background{});
  CHECK(settled(photographs, true).background == photographs.background);
  settings.background = {{1, 1, 1}};
  CHECK(settled(settings, true).background.colour == std::array<double, 3>{1, 1, 1});
  CHECK(settled(settings, true).random_background == RandomBackground::on);
  settings.background.learnt = Background::Learnt::colour;
  CHECK(settled(settings, true).random_background == RandomBackground::off);
  settings.random_background = RandomBackground::on;
  CHECK_THROWS_WITH(validate(settings), Catch::Contains("random_background = on does not support"));
  settings.background = {};
  CHECK_THROWS_WITH(settled(settings, false), Catch::Contains("requires opaque images"));
}

TEST_CASE("fast settings: with lr_cooldown, learning rates fall to zero at the end", "[schedule]") {
  const test::Data data = synthetic("glossy", 32, 4);
  for (const auto& device : devices_under_test()) {
    const auto after = [&](double cooldown, int iterations) {
      TrainSettings settings = test::short_run(6, 20, 300);
      settings.lr_cooldown = cooldown;
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

TEST_CASE("data_specs: published.yaml and fast.yaml agree with the settings in the code", "[schedule]") {
  const auto text_of = [](TrainSettings settings, std::string_view without) {
    std::string text;
    for (const FieldValue& field : bind_fields(settings, train_fields()))
      if (std::string_view(field.key) != without)
        text += fmt::format("{}={}\n", field.key, field_text(field));
    return text;
  };
  const std::filesystem::path folder = std::filesystem::path(UBS_SOURCE_DIR) / "data_specs";
  TrainSettings published = fast_settings(), fast;
  load_yaml(bind_fields(published, train_fields()), folder / "published.yaml");
  TrainSettings standard;
  standard.init_points = 100000;
  standard.init_extent = 1.3;
  standard.conditioning_auto = false;
  standard.unit = 1;
  standard.background = {};
  standard.random_background = RandomBackground::off;
  CHECK(text_of(published, "") == text_of(standard, ""));
  load_yaml(bind_fields(fast, train_fields()), folder / "fast.yaml");
  TrainSettings many = fast_settings();
  many.cap_max = 30000;
  CHECK(text_of(fast, "growth") == text_of(fast_settings_for(many, 2000, 9000), "growth"));
  CHECK(Schedule(fast, 9000).splats_at(0.5) == 30000);
}

}  // namespace ubs
