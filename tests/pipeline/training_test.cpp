// SPDX-License-Identifier: Apache-2.0
// Tests training as a whole: it reaches the expected quality, is reproducible bit for bit, and adds splats up
// to the cap but not beyond it.
#include <catch2/catch.hpp>

#include "host/train/run_settings.hpp"
#include "host/train/training_views.hpp"
#include "tests/pipeline/training_runs.hpp"
#include "tests/support/data.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/whole_sweep.hpp"

namespace ubs {
namespace {

using test::Data;
using test::load;
using test::Outcome;
using test::short_run;
using test::synthetic;
using test::train;

TEST_CASE("training reaches the expected quality on the built-in scenes", "[training]") {
  struct Row {
    const char* scene;
    int dim;
    double floor;  // minimum test PSNR [dB], about 1 dB below the value on PoCL when the test was written
  };
  for (const auto& device : devices_under_test())
    for (const Row& row :
         {Row{"glossy", 6, 20.0}, Row{"glossy", 3, 21.3}, Row{"orbit", 7, 20.8}, Row{"orbit", 4, 20.6}}) {
      DYNAMIC_SECTION(device->info().name << ", " << row.scene << ", N = " << row.dim) {
        const Data data = synthetic(row.scene, 64, 24);
        const Outcome outcome = train(*device, short_run(row.dim, 400, 2000), data);
        WARN(row.scene << " N = " << row.dim << ": test PSNR " << outcome.test.mean.psnr << " dB");
        CHECK(outcome.losses.back() < 0.5 * outcome.losses.front());
        CHECK(outcome.test.mean.psnr > row.floor);
      }
    }
}

TEST_CASE("two training runs with the same seed give identical bits", "[training][determinism]") {
  const Data data = synthetic("glossy", 40, 10);
  for (const auto& device : devices_under_test())
    for (const std::string& raster : raster_names_of(*device)) {
      DYNAMIC_SECTION(device->info().name << ", raster " << raster) {
        TrainSettings settings = short_run(6, 120, 700);
        settings.cap_max = 900;
        settings.raster = raster;
        const Outcome first = train(*device, settings, data);
        const Outcome second = train(*device, settings, data);
        CHECK(first.model.count == 900);
        CHECK(test::same_bits(first.model.values, second.model.values));
        if (settings.raster == "gpu") continue;  // testing the seed with one rasteriser is enough
        settings.seed = 43;
        const Outcome other = train(*device, settings, data);
        CHECK(first.model.values != other.model.values);
      }
    }
}

// Compares the two values of the setting list_counts. With `bound`, the lists of intersections have room
// for as many entries as earlier views needed, and a step is repeated if this is too small. Here, this
// happens several times, because the number of splats grows by a factor of five, and views differ. With
// `wait`, a step waits for the size of its lists.
TEST_CASE("training with list_counts = bound gives the same bits as with list_counts = wait",
          "[training][determinism]") {
  const Data data = synthetic("glossy", 40, 10);
  const auto run = [&](Device& device, const TrainSettings& settings, IntersectionCount& count) {
    Trainer trainer(device, settle(settings), data.train, data.test, initialise_random(6, 300, 42, {}));
    std::vector<double> losses;
    trainer.run([&](const StepReport& report) {
      if (report.loss) losses.push_back(*report.loss);
      return true;
    });
    count = trainer.scene().intersections();
    return std::pair{trainer.state(), losses};
  };
  for (const auto& device : devices_under_test())
    for (const std::string& raster : raster_names_of(*device))
      for (const int batch : {1, 3}) {
        // The handling of the lists does not depend on the rasteriser, so testing batches of three views with
        // one of them is enough.
        if (batch == 3 && raster == "gpu" && !test::whole_sweep()) continue;
        DYNAMIC_SECTION(device->info().name << ", raster " << raster << ", batch " << batch) {
          TrainSettings settings = short_run(6, 80, 300);
          settings.cap_max = 1500;
          settings.growth = 1.3;
          settings.refine.step = 1500;
          settings.batch = batch;
          settings.raster = raster;
          settings.eval_every = "30";  // so that the same renderer also renders test views during training
          settings.list_counts = ListCounts::wait;
          IntersectionCount waited, bounded;
          const auto [expected, expected_losses] = run(*device, settings, waited);
          settings.list_counts = ListCounts::bound;
          const auto [found, losses] = run(*device, settings, bounded);
          CHECK(expected.model.count == 1500);
          CHECK(found.model.values == expected.model.values);
          CHECK(found.moment1 == expected.moment1);
          CHECK(found.moment2 == expected.moment2);
          CHECK(losses == expected_losses);
          CHECK(waited.repeated == 0);
          CHECK(bounded.repeated >= 3);  // with PoCL, four steps are repeated
          CHECK(bounded.repeated < 40);
          CHECK(bounded.most == waited.most);
          CHECK(bounded.total == waited.total);
          CHECK(bounded.views == waited.views);
        }
      }
}

TEST_CASE("training with batches of four views reduces the loss", "[training]") {
  const Data data = synthetic("glossy", 40, 8);
  for (const auto& device : devices_under_test()) {
    TrainSettings settings = short_run(6, 60, 500);
    settings.batch = 4;
    const Outcome outcome = train(*device, settings, data);
    CHECK(outcome.losses.back() < outcome.losses.front());
  }
}

TEST_CASE("the cap is raised to the initial count and never exceeded", "[training]") {
  const Data data = synthetic("glossy", 32, 6);
  for (const auto& device : devices_under_test()) {
    TrainSettings settings = short_run(3, 100, 400);
    settings.cap_max = 10;
    CHECK(train(*device, settings, data).model.count == 400);
    settings.cap_max = 430;
    CHECK(train(*device, settings, data).model.count == 430);
  }
}

TEST_CASE("every view is used once per epoch, and the order only depends on seed and counter", "[training]") {
  ViewOrder order(7, 13);
  std::vector<std::uint32_t> first;
  for (std::uint64_t draw = 0; draw < 39; ++draw) first.push_back(order(draw));
  for (std::size_t epoch = 0; epoch < 3; ++epoch) {
    std::vector<std::uint32_t> views(first.begin() + static_cast<std::ptrdiff_t>(13 * epoch),
                                     first.begin() + static_cast<std::ptrdiff_t>(13 * epoch + 13));
    std::sort(views.begin(), views.end());
    for (std::uint32_t i = 0; i < 13; ++i) CHECK(views[i] == i);
  }
  CHECK_FALSE(std::equal(first.begin(), first.begin() + 13, first.begin() + 13));
  ViewOrder again(7, 13);
  CHECK(again(38) == first[38]);
  CHECK(again(5) == first[5]);
}

TEST_CASE("training on lego at 200x200 reaches the expected quality", "[training][data]") {
  if (!test::whole_sweep()) return;
  UBS_REQUIRE_DATA(folder, "lego_200");
  const Data data = load(folder);
  for (const auto& device : devices_under_test()) {
    const Outcome outcome = train(*device, short_run(6, 500, 10000), data);
    WARN("lego_200, 6-D, 500 iterations: test PSNR " << outcome.test.mean.psnr << " dB");
    CHECK(outcome.test.mean.psnr > 19.0);  // PoCL reached 19.96 dB when this test was written
  }
}

TEST_CASE("a view with its own background is trained with this background, without sky", "[training]") {
  Data data = synthetic("glossy", 32, 2);
  data.train.views[1].background = {0.25f, 0.5f, 0.75f};
  for (const RandomBackground random : {RandomBackground::off, RandomBackground::on}) {
    TrainSettings settings = short_run(6, 10, 50);
    settings.random_background = random;
    TrainingViews views(*devices_under_test().front(), settings, data.train, data.test);
    RenderSettings drawn = render_settings(settings);
    drawn.sky.emplace();
    for (std::uint64_t draw = 0; draw < 4; ++draw) {
      const RenderSettings found = views.settings_of(draw, drawn);
      const bool own = views.view_of(draw) == 1;
      CHECK((found.background == std::array{0.25f, 0.5f, 0.75f}) == own);
      CHECK(found.sky.has_value() == !own);
    }
  }
}

}  // namespace
}  // namespace ubs
