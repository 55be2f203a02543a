// SPDX-License-Identifier: Apache-2.0
// Tests of the benchmark on devices. The measurements must cover the stages, settings and variants that they
// name, and the memory that is allocated must agree with the estimate.
#include <catch2/catch.hpp>

#include "host/device/registry.hpp"
#include "host/lab/bench/runner.hpp"
#include "host/lab/bench/step_bench.hpp"
#include "host/lab/bench/training_bench.hpp"
#include "host/pipeline/memory_plan.hpp"
#include "host/train/trainer.hpp"
#include "kernels/layout.h"
#include "tests/support/device_fixture.hpp"
#include "tests/support/published.hpp"
#include "tests/support/temp_folder.hpp"
#include "tests/support/whole_sweep.hpp"

namespace ubs {
namespace {

using namespace bench;

constexpr SamplingLimits kOnce{.uncertainty = 1, .min_seconds = 0, .max_seconds = 0.01, .min_samples = 1};

MemoryQuestion question_of(const Device& device, const BenchScene& scene, RasterKind raster) {
  const Camera& camera = scene.views.views[0].camera;
  return {.dim = scene.model.dim,
          .splats = scene.model.count,
          .width = camera.width,
          .height = camera.height,
          .views = scene.views.views.size(),
          .raster = raster,
          .sorts_by_copying = device.info().sorts_by_copying,
          .compute_units = device.info().compute_units};
}

TEST_CASE("memory plan: training allocates what was predicted", "[memory]") {
  for (const auto& device : devices_under_test())
    for (const RasterKind raster : rasters_of(*device))
      for (const int dim : {3, 6, 7}) {
        if (dim == 7 && !test::whole_sweep()) continue;
        const BenchScene scene = synthetic_object(dim, 20'000, 200, 150, 3);
        const IterationMeasurement m =
            measure_iterations(*device, scene, {.raster = raster, .limits = kOnce});
        const double ratio = static_cast<double>(m.peak_bytes) / static_cast<double>(m.predicted_bytes);
        INFO(device->info().name << ", N = " << dim << ", raster "
                                 << (raster == RasterKind::cpu ? "cpu" : "gpu")
                                 << ": peak / predicted = " << ratio);
        // The ratios observed on PoCL are 0.977 to 0.987. The estimate includes the scratch memory of
        // refinement, which is allocated only by the first refinement.
        CHECK(ratio > 0.97);
        CHECK(ratio < 1.01);
      }
}

TEST_CASE("memory plan: rendering and a growing model allocate what was predicted", "[memory]") {
  for (const auto& device : devices_under_test()) {
    const RasterKind raster = raster_kind("auto", device->info());
    const BenchScene scene = synthetic_object(6, 20'000, 200, 150, 1);
    const std::uint64_t before = device->allocated_bytes();
    {
      device->reset_peak();
      const auto stages = make_stages(*device, {.dim = 6, .raster = raster, .backward = false});
      const DeviceModel model(*device, scene.model);
      Renderer renderer(*device, *stages);
      renderer.set_cameras({scene.views.views[0].camera});
      renderer.forward(model.view(), 0, {}, false);
      MemoryQuestion question = question_of(*device, scene, raster);
      question.training = false;
      question.intersections = renderer.intersections();
      const double ratio = static_cast<double>(device->peak_bytes() - before) /
                           static_cast<double>(plan_memory(question).total());
      CHECK(ratio > 0.99);  // the ratio observed on PoCL is 1.000
      CHECK(ratio < 1.01);
    }
    TrainSettings settings = test::published();
    settings.iterations = 100;
    settings.init_points = 1000;
    settings.cap_max = 8000;
    settings.growth = 1.2;
    settings.refine.first = 0;
    const Split none{"test", {}};
    const BenchScene start = random_start(6, 1000, 120, 90);
    device->reset_peak();
    Trainer trainer(*device, settle(settings), start.views, none, start.model);
    trainer.run([](const StepReport&) { return true; });
    const MemoryPlan plan = trainer.memory_plan();
    const double ratio =
        static_cast<double>(device->peak_bytes() - before) / static_cast<double>(plan.total());
    INFO(summary(plan) << ", ratio " << ratio);
    CHECK(trainer.scene().device_model().count() == 8000);
    CHECK(ratio > 0.97);  // the ratio observed on PoCL is 1.009
    CHECK(ratio < 1.03);
  }
}

TEST_CASE("memory plan: bytes per splat, pixel and intersection", "[memory]") {
  const MemoryPlan plan =
      plan_memory({.dim = 6, .splats = 64'000, .width = 160, .height = 160, .intersections = 1000});
  // A splat needs four arrays of 35 parameters, its record and the gradient of the record (16 words each),
  // five words for keys and counts, three words for sorting, and four words for relocation and growth.
  CHECK(plan.each(MemoryUnit::splat) == 4 * (4 * 35 + 16 + 16 + 5 + 3 + 4));
  CHECK(plan.each(MemoryUnit::intersection) == 4 * 2 + 2 + 64);
  CHECK(plan.largest().bytes == row_stride(64'000) * 35ull * 4);
  const MemoryPlan render = plan_memory(
      {.dim = 6, .splats = 64'000, .width = 160, .height = 160, .intersections = 1000, .training = false});
  CHECK(render.each(MemoryUnit::splat) == 4 * (35 + 16 + 4 + 3));
  CHECK(render.each(MemoryUnit::pixel) == 16);
  CHECK(render.each(MemoryUnit::intersection) == 4);
  CHECK(render.total() < plan.total());
  // The keys of the sort by tile have 2 bytes up to 65536 tiles, and 4 bytes beyond.
  MemoryQuestion card{.dim = 6, .width = 4096, .height = 4096, .training = false, .raster = RasterKind::gpu};
  CHECK(plan_memory(card).each(MemoryUnit::intersection) == 4 + 10 + 2 * 2 + 4);
  card.sorts_by_copying = true;
  CHECK(plan_memory(card).each(MemoryUnit::intersection) == 4 + 10 + 3 * 2 + 2 * 4);
  card.width = 4097;
  CHECK(plan_memory(card).each(MemoryUnit::intersection) == 4 + 10 + 3 * 4 + 2 * 4);
  CHECK(summary(plan).find("MiB") != std::string::npos);
}

// With alpha_min there are fewer intersections, so the number of intersections shows whether the setting is
// used.
TEST_CASE("bench: the setting alpha_min applies to single stages and to whole iterations", "[bench]") {
  for (const auto& device : devices_under_test()) {
    const BenchScene scene = synthetic_object(3, 3'000, 100, 70, 1);
    const auto of_step = [&](const TrainSettings& settings) {
      return StepBench(*device, scene, RasterKind::cpu, settings).totals().intersections;
    };
    TrainSettings settings = test::published();
    settings.alpha_min = 0.1;
    CHECK(of_step(settings) < of_step({}));
    const auto of_iteration = [&](const TrainSettings& work) {
      return measure_iterations(*device, scene, {.limits = {1, 0, 0.01, 1}, .work = work}).intersections;
    };
    CHECK(of_iteration({}) == of_step({}));
    CHECK(of_iteration(settings) == of_step(settings));
  }
}

TEST_CASE("bench: a model is measured with the variant of the model", "[bench]") {
  const ModelVariant form{.kernel = SpatialKernel::gaussian, .colour = ColourMode::sh1};
  for (const auto& device : devices_under_test()) {
    const RasterKind raster = raster_kind("auto", device->info());
    const BenchScene scene = random_start(3, 2'000, 64, 64, form);
    StepBench bench(*device, scene, raster);
    for (const std::string& stage : step_stages()) CHECK(bench.measure(stage, kOnce).wall_ms.median > 0);
    // The support of the Beta kernel ends at a distance of 1 in units of the ellipse, and the support of the
    // Gaussian kernel at 3.33.
    const auto beta = StepBench(*device, random_start(3, 2'000, 64, 64), raster).totals().intersections;
    CHECK(bench.totals().intersections > 2 * beta);
    const IterationMeasurement m = measure_iterations(*device, scene, {.raster = raster, .limits = kOnce});
    CHECK(m.time.wall_ms.median > 0);
  }
}

TEST_CASE("bench: every stage is measured, and the model is not changed", "[bench]") {
  for (const auto& device : devices_under_test()) {
    const BenchScene scene = synthetic_object(6, 2'000, 64, 48, 2);
    StepBench bench(*device, scene, raster_kind("auto", device->info()));
    for (const std::string& stage : step_stages()) {
      const Measured m = bench.measure(stage, kOnce);
      INFO(stage);
      CHECK(m.wall_ms.median > 0);
      CHECK(m.device_ms.value_or(0) > 0);
    }
    CHECK(bench.measure("forward_backward", kOnce).wall_ms.median > 0);
    const auto outputs = bench.outputs();
    bench.measure("forward_backward", kOnce);
    CHECK((bench.outputs() == outputs));
    CHECK_THROWS_AS(bench.measure("nothing", kOnce), Error);
  }
}

TEST_CASE("bench: measured iterations do not change the number of intersections", "[bench]") {
  for (const auto& device : devices_under_test()) {
    const BenchScene scene = synthetic_object(6, 2'000, 64, 64, 1);
    const std::uint64_t before =
        StepBench(*device, scene, raster_kind("auto", device->info())).totals().intersections;
    const IterationMeasurement m = measure_iterations(
        *device, scene, {.raster = raster_kind("auto", device->info()), .limits = {1, 0.5, 30, 40}});
    CHECK(m.time.wall_ms.samples >= 40);  // 200 iterations, with refinements
    CHECK(m.intersections == before);
  }
}

TEST_CASE("bench: the result of a case for which the host has too little memory contains a note", "[bench]") {
  bench::RunOptions options;
  options.quick = true;
  options.limits = kOnce;
  options.cases = {{"render", "model", 100, 32, 32}, {"render", "synthetic", 100, 32, 32}};
  options.open_model = []() -> BenchScene { throw std::bad_alloc(); };
  options.training.variant.kernel = SpatialKernel::gaussian;
  const DeviceReport report = run_cases(*open_device(""), options);
  REQUIRE(report.results.size() == 2);
  CHECK(report.results[0].note == "out of memory");
  CHECK(report.results[0].wall_ms.samples == 0);
  CHECK(report.results[1].wall_ms.samples > 0);
  CHECK(report.results[1].form == "default");
}

}  // namespace
}  // namespace ubs
