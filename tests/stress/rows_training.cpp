// SPDX-License-Identifier: Apache-2.0
// This file contains the stress tests (row.hpp) of training: few or equal views, initial models with special
// values, long runs, and repeated runs, which must be bit-identical.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>

#include "host/base/error.hpp"
#include "host/base/temporary_folder.hpp"
#include "host/formats/ply.hpp"
#include "host/train/trainer.hpp"
#include "tests/stress/row.hpp"
#include "tests/support/published.hpp"

namespace ubs::stress {
namespace {

// Returns `count` views of a fixed model with rendered images. If `equal` is true, all views have the same
// camera pose and differ only in their times.
Split make_views(DeviceRunner& runner, int count, bool equal) {
  const Case truth = ordinary_case("truth", 3, 30, 5);
  Split split{"train", {}};
  for (int i = 0; i < count; ++i) {
    Case c = truth;
    const double angle = equal ? 0 : 0.15 * i, s = std::sin(angle), k = std::cos(angle);
    c.camera.rotation = {k, 0, s, 0, 1, 0, -s, 0, k};
    c.camera.translation = {-2.25 * s, 0, 2.25 - 2.25 * k};
    c.camera.time = count > 1 ? static_cast<double>(i) / (count - 1) : 0;
    const DeviceResult drawn = runner.run(c, {});
    View view;
    view.name = fmt::format("view{}", i);
    view.camera = c.camera;
    view.image = {c.camera.width, c.camera.height, {}};
    const std::size_t pixels = drawn.alpha.size();
    for (std::size_t p = 0; p < pixels; ++p)
      for (std::size_t channel = 0; channel < 3; ++channel)
        view.image.rgb.push_back(static_cast<std::uint8_t>(
            std::lround(255 * std::clamp(drawn.image[channel * pixels + p], 0.0f, 1.0f))));
    split.views.push_back(std::move(view));
  }
  return split;
}

TrainSettings settings_for(const DeviceRunner& runner, int dim, int iterations) {
  TrainSettings settings = test::published(dim);
  settings.iterations = iterations;
  settings.cap_max = 120;
  settings.background = {0.1, 0.2, 0.3};
  settings.raster = runner.raster() == RasterKind::cpu ? "cpu" : "gpu";
  settings.log_every = 50;
  return settings;
}

struct Training {
  SplatModel model;
  double first_loss = 0, last_loss = 0;
  int iterations = 0;
};

Training train(Device& device, const TrainSettings& settings, const Split& views, const SplatModel& initial) {
  const Split none{"test", {}};
  Trainer trainer(device, settle(settings), views, none, initial);
  Training result;
  trainer.run([&](const StepReport& report) {
    if (report.loss) {
      if (result.first_loss == 0) result.first_loss = *report.loss;
      result.last_loss = *report.loss;
    }
    return true;
  });
  result.model = trainer.model();
  result.iterations = trainer.iteration();
  return result;
}

bool finite(const SplatModel& model) {
  return std::ranges::all_of(model.values, [](float v) { return std::isfinite(v); });
}

TEST_CASE_METHOD(Row, "few views: one view, three views, or three views with the same pose", "[training]") {
  for (const int dim : {3, 6, 7})
    for (const auto& [count, equal] : {std::pair{1, false}, {3, false}, {3, true}}) {
      INFO("N = " << dim << ", " << count << " views" << (equal ? " (equal)" : ""));
      const Training t = train(device(), settings_for(runner(), dim, 120), make_views(runner(), count, equal),
                               ordinary_case("start", dim, 60).model);
      CHECK(finite(t.model));
      CHECK(t.last_loss < t.first_loss);
    }
}

// Either training ends with a finite model, which can be written to a file, or it stops with an error. The
// message must contain the index of the splat and the stage and, if the value occurred after a step, the
// view.
TEST_CASE_METHOD(Row, "poisoned training: initial models with NaN, infinities or 3.4e38", "[training]") {
  const TemporaryFolder folder;
  const Split views = make_views(runner(), 2, false);
  constexpr std::size_t kPoisoned = 3;
  std::size_t stopped = 0;
  for (const int dim : {3, 6})
    for (const float value : {NAN, INFINITY, -INFINITY, 3.4e38f})
      for (int row = 0; row < ParameterLayout(dim).count; row += 3) {
        INFO("N = " << dim << ", row " << row << " = " << value);
        SplatModel start = ordinary_case("start", dim, 20).model;
        start.row(row)[kPoisoned] = value;
        try {
          const Training t = train(device(), settings_for(runner(), dim, 40), views, start);
          write_splat_ply(folder.path() / "model.ply", t.model);
          CHECK(finite(t.model));
        } catch (const Error& error) {
          ++stopped;
          CHECK(error.kind() == ErrorKind::numerical);
          using Catch::Contains;
          CHECK_THAT(error.what(), Contains(fmt::format("splat {}", kPoisoned)) && Contains("stage "));
          CHECK_THAT(error.what(), Contains("stage parameters") || Contains("view '"));
        }
      }
  CHECK(stopped > 0);
}

// Training must end with a finite model for all of these initial scales and betas.
TEST_CASE_METHOD(Row, "stiff training: initial scales of 1e-7 and 1e3, betas of -12 and 12", "[training]") {
  const Split views = make_views(runner(), 2, false);
  for (const int dim : {3, 7})
    for (const double scale : {1e-7, 1e3})
      for (const double beta : {-12.0, 12.0}) {
        INFO("N = " << dim << ", scale " << scale << ", beta " << beta);
        Case c = row_case("stiff", dim, 20);
        for (std::size_t i = 0; i < 20; ++i) {
          SplatPlan plan;
          plan.scale = {scale, 0.3, 0.3}, plan.beta_raw = beta, plan.query_beta_raw = -beta,
          plan.opacity_raw = 12;
          plan.position = {0.1 * static_cast<double>(i % 5) - 0.2, 0.1 * static_cast<double>(i / 5) - 0.2, 2};
          put_splat(c, i, plan);
        }
        CHECK(finite(train(device(), settings_for(runner(), dim, 60), views, c.model).model));
      }
}

TEST_CASE_METHOD(Row, "long training: 3000 iterations on a tiny scene, with relocation, growth and noise",
                 "[training]") {
  const Training t = train(device(), settings_for(runner(), 6, 3000), make_views(runner(), 3, false),
                           ordinary_case("start", 6, 60).model);
  CHECK(finite(t.model));
  CHECK(t.iterations == 3000);
  CHECK(t.last_loss < t.first_loss);
}

TEST_CASE_METHOD(Row, "repeated training: two runs with the same seed are bit-identical", "[training]") {
  const Split views = make_views(runner(), 3, false);
  for (const int dim : {3, 7}) {
    INFO("N = " << dim);
    const SplatModel start = ordinary_case("start", dim, 50).model;
    const TrainSettings settings = settings_for(runner(), dim, 150);
    const std::vector<float> a = train(device(), settings, views, start).model.values,
                             b = train(device(), settings, views, start).model.values;
    CHECK(same_bits(a, b));
    CHECK(a != start.values);
  }
}

}  // namespace
}  // namespace ubs::stress
