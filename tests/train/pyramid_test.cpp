// SPDX-License-Identifier: Apache-2.0
// Tests training that starts with reduced images (the setting `pyramid`). The tests cover the levels and the
// iterations at which they change, the reduced images, which are compared with an independent computation,
// and runs that are resumed before and after a change of the level.
#include "host/train/pyramid.hpp"

#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>

#include "host/base/philox.hpp"
#include "host/train/plan.hpp"
#include "tests/pipeline/training_runs.hpp"
#include "tests/support/device_fixture.hpp"

namespace ubs {
namespace {

using test::Data;
using test::kNone;
using test::message_of;
using test::short_run;
using test::synthetic;

using Levels = std::vector<PyramidLevel>;

Split views_of(int width, int height) {
  View view;
  view.camera.width = width;
  view.camera.height = height;
  return {"train", {view}};
}

TrainSettings with(const std::string& pyramid, int iterations) {
  TrainSettings settings = test::published();
  settings.pyramid = pyramid;
  settings.iterations = iterations;
  return settings;
}

Image8 noisy(int width, int height, bool masked) {
  const CounterRandom random(7, 1);
  Image8 image{width, height, {}, {}};
  for (std::uint64_t i = 0; i < static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height); ++i) {
    for (std::uint32_t c = 0; c < 3; ++c)
      image.rgb.push_back(static_cast<std::uint8_t>(random.bits(i, c) & 255));
    if (masked) image.mask.push_back(random.bits(i, 3) % 5 < 3 ? 255 : 0);
  }
  return image;
}

}  // namespace

TEST_CASE("pyramid: levels depend on the setting and on the size of the images", "[pyramid]") {
  CHECK(pyramid_levels(with("", 100), views_of(800, 600)) == Levels{{1, 1}});
  const Levels three = pyramid_levels(with("4:0.2,2:0.5", 1000), views_of(800, 600));
  CHECK(three == Levels{{4, 0.2}, {2, 0.5}, {1, 1}});
  for (const auto& [iteration, factor] : {std::pair{1, 4}, {200, 4}, {201, 2}, {500, 2}, {501, 1}, {1000, 1}})
    CHECK(factor_at(three, WorkShare(with("", 1000)), iteration) == factor);
  // Small images are reduced less, and equal levels are merged.
  CHECK(pyramid_levels(with("8:0.1,4:0.2,2:0.5", 1000), views_of(300, 256)) ==
        Levels{{4, 0.2}, {2, 0.5}, {1, 1}});
  CHECK(pyramid_levels(with("4:0.2,2:0.5", 1000), views_of(200, 200)) == Levels{{2, 0.5}, {1, 1}});
  CHECK(pyramid_levels(with("4:0.2,2:0.5", 1000), views_of(4000, 100)) == Levels{{1, 1}});
  // In a run of one iteration, the level with the factor 2 ends at iteration 0.5, which is rounded to 1.
  CHECK(factor_at(three, WorkShare(with("", 1)), 1) == 2);
  for (const char* wrong : {"2", "2:", "2:0.5,", "2:0.5,4:0.7", "4:0.5,2:0.2", "2:0", "2:1", "1:0.5",
                            "65:0.5", "2.5:0.5", "2:nan", ":0.5", "2:0.5;1:0.7", "2:0.5x"})
    CHECK(message_of([&] { validate(with(wrong, 100)); }, ErrorKind::usage).find("pyramid") !=
          std::string::npos);
}

TEST_CASE("pyramid: an image is reduced to the means of square blocks", "[pyramid]") {
  for (const bool masked : {false, true})
    for (const int factor : {2, 3, 4}) {
      const Image8 image = noisy(31, 22, masked), small = reduced(image, factor);
      REQUIRE(small.width == 31 / factor);
      REQUIRE(small.height == 22 / factor);
      REQUIRE(small.rgb.size() == static_cast<std::size_t>(small.width * small.height * 3));
      std::size_t wrong = 0, hidden = 0;
      for (int y = 0; y < small.height; ++y)
        for (int x = 0; x < small.width; ++x) {
          std::vector<double> values[3];
          for (int k = 0; k < factor * factor; ++k) {
            const auto at =
                static_cast<std::size_t>((y * factor + k / factor) * 31 + x * factor + k % factor);
            if (masked && image.mask[at] == 0) continue;
            for (std::size_t c = 0; c < 3; ++c) values[c].push_back(image.rgb[3 * at + c]);
          }
          const auto to = static_cast<std::size_t>(y * small.width + x);
          const double share = static_cast<double>(values[0].size()) / (factor * factor);
          if (masked) wrong += small.mask[to] != (share >= 0.5 ? 255 : 0);
          hidden += share < 0.5;
          if (values[0].empty()) continue;
          for (std::size_t c = 0; c < 3; ++c) {
            double sum = 0;
            for (const double v : values[c]) sum += v;
            wrong += small.rgb[3 * to + c] !=
                     static_cast<int>(std::floor(sum / static_cast<double>(values[c].size()) + 0.5));
          }
        }
      CHECK(wrong == 0);
      CHECK((hidden > 0) == masked);
      CHECK(small.mask.empty() == !masked);
    }
}

// The centre of a pixel of the reduced camera must be the centre of its block of pixels of the original
// camera.
TEST_CASE("pyramid: a reduced camera sees the same part of the scene", "[pyramid]") {
  Camera camera;
  camera.width = 401;
  camera.height = 302;
  camera.fx = 380;
  camera.fy = 390;
  camera.cx = 199.5;
  camera.cy = 155.25;
  const Camera small = reduced(camera, 4);
  CHECK(small.width == 100);
  CHECK(small.height == 75);
  for (const double column : {0.5, 17.5, 99.5})
    CHECK((column - small.cx) / small.fx == Approx((4 * column - camera.cx) / camera.fx).epsilon(1e-14));
  for (const double row : {0.5, 33.5})
    CHECK((row - small.cy) / small.fy == Approx((4 * row - camera.cy) / camera.fy).epsilon(1e-14));
}

TEST_CASE("pyramid: a run resumed on any level is bit-identical to an uninterrupted one", "[pyramid]") {
  const Data data = synthetic("glossy", 144, 5);
  for (const auto& device : devices_under_test())
    for (const bool masked : {false, true}) {
      Split train = data.train;
      if (masked)
        for (View& view : train.views) {
          view.masked = true;
          view.image.mask.assign(view.image.rgb.size() / 3, 255);
          std::fill_n(view.image.mask.begin(), 144 * 40, std::uint8_t{0});
        }
      TrainSettings settings = short_run(masked ? 3 : 6, 24, 300);
      settings.pyramid = "2:0.5";  // half the size until iteration 12
      settings.batch = masked ? 2 : 1;
      settings.cap_max = 400;
      settings.refine.step = 2500;
      const SplatModel start = initialise_random(settings.dim, 300, settings.seed);
      std::vector<std::pair<int, int>> widths;
      Trainer whole(*device, settle(settings), train, data.test, start);
      whole.run([&](const StepReport& report) {
        widths.emplace_back(report.iteration, whole.scene().renderer().shape().width);
        return true;
      });
      for (const auto& [iteration, width] : widths)
        if (iteration < 24) CHECK(width == (iteration <= 12 ? 72 : 144));
      const TrainState end = whole.state();
      CHECK(end.model.count > 300);
      for (const int cut : {5, 11, 12, 13, 20}) {
        INFO(device->info().name << ", masked " << masked << ", cut at " << cut);
        Trainer first(*device, settle(settings), train, data.test, start);
        first.run([&](const StepReport& report) { return report.iteration < cut; });
        Trainer second(*device, settle(settings), train, data.test, first.model());
        second.restore(first.state());
        // An evaluation on full images does not change training.
        CHECK(second.evaluate_test().mean.psnr == first.evaluate_test().mean.psnr);
        second.run([](const StepReport&) { return true; });
        const TrainState got = second.state();
        REQUIRE(got.model.values.size() == end.model.values.size());
        CHECK(std::memcmp(got.model.values.data(), end.model.values.data(),
                          end.model.values.size() * sizeof(float)) == 0);
        CHECK(got.moment2 == end.moment2);
      }
    }
}

TEST_CASE("pyramid: images that do not stay on the device are reduced in the same way", "[pyramid]") {
  Split split = views_of(64, 48);
  split.views.resize(3, split.views[0]);
  for (View& view : split.views) view.image = noisy(64, 48, true);
  for (const auto& device : devices_under_test())
    for (const std::size_t budget : {std::size_t{0}, std::size_t{1} << 20}) {
      TargetImages targets(*device, budget);
      targets.add(split);
      for (const int factor : {4, 2, 1}) {
        targets.reduce(2, factor);
        for (const std::size_t index : {0, 1, 2, 0}) {
          const Image8 expected = reduced(split.views[index].image, index < 2 ? factor : 1);
          const Target target = targets.get(index);
          std::vector<std::uint8_t> planes(expected.rgb.size()), mask(expected.mask.size());
          device->read(*target.image.memory, 0, std::as_writable_bytes(std::span(planes)));
          device->read(*target.mask.memory, 0, std::as_writable_bytes(std::span(mask)));
          std::size_t wrong = 0;
          for (std::size_t i = 0; i < planes.size(); ++i)
            wrong += planes[i] != expected.rgb[3 * (i % mask.size()) + i / mask.size()];
          CHECK(wrong == 0);
          CHECK(mask == expected.mask);
          CHECK(target.counted == mask.size() - static_cast<std::size_t>(std::ranges::count(mask, 0)));
        }
      }
    }
}

TEST_CASE("pyramid: the planned time is the sum over all levels", "[pyramid][plan]") {
  const Data data = synthetic("glossy", 160, 4);
  for (const auto& device : devices_under_test()) {
    TrainSettings settings = short_run(3, 1000, 2000);
    settings.pyramid = "2:0.5";
    const SplatModel start = initialise_random(3, 2000, 1);
    const RunPlan plan = plan_training(*device, settle(settings), data.train, kNone, start);
    REQUIRE(plan.levels.size() == 2);
    CHECK((plan.levels[0].factor == 2 && plan.levels[0].until == 500));
    CHECK(plan.levels[0].start_ms > 0);
    CHECK(plan.seconds == Approx(0.5 * (plan.levels[0].start_ms + plan.levels[1].start_ms)).epsilon(1e-9));
    settings.pyramid.clear();
    const RunPlan full = plan_training(*device, settle(settings), data.train, kNone, start);
    CHECK(full.start.most_intersections == plan.start.most_intersections);
    CHECK(full.memory.total() == plan.memory.total());
  }
}

}  // namespace ubs
