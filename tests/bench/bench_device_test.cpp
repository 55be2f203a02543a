// SPDX-License-Identifier: Apache-2.0
// Benchmark scenes and measurements on the devices: they are what they claim to be, and memory is what the
// plan says.
#include <sched.h>

#include <atomic>
#include <catch2/catch.hpp>
#include <cmath>
#include <thread>

#include "host/base/stopwatch.hpp"
#include "host/bench/core_trip.hpp"
#include "host/bench/runner.hpp"
#include "host/bench/step_bench.hpp"
#include "host/bench/training_bench.hpp"
#include "host/device/registry.hpp"
#include "host/pipeline/memory_plan.hpp"
#include "host/train/trainer.hpp"
#include "kernels/layout.h"
#include "tests/support/device_fixture.hpp"
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
        // Observed on PoCL: 0.977 to 0.987; the scratch of refinement, predicted, comes with the first one.
        CHECK(ratio > 0.97);
        CHECK(ratio < 1.01);
      }
}

TEST_CASE("memory plan: rendering and a run with growth", "[memory]") {
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
      CHECK(ratio > 0.99);  // observed on PoCL: 1.000
      CHECK(ratio < 1.01);
    }
    TrainSettings settings;
    settings.iterations = 100;
    settings.init_points = 1000;
    settings.cap_max = 8000;
    settings.growth = 1.2;
    settings.refine.first = 0;
    const Split none{"test", {}};
    const BenchScene start = random_start(6, 1000, 120, 90);
    device->reset_peak();
    Trainer trainer(*device, settings, start.views, none, start.model);
    trainer.run([](const StepReport&) { return true; });
    const MemoryPlan plan = trainer.memory_plan();
    const double ratio =
        static_cast<double>(device->peak_bytes() - before) / static_cast<double>(plan.total());
    INFO(summary(plan) << ", ratio " << ratio);
    CHECK(trainer.device_model().count() == 8000);  // ratio observed on PoCL: 1.009
    CHECK(ratio > 0.97);
    CHECK(ratio < 1.03);
  }
}

TEST_CASE("memory plan: what a splat, a pixel and an intersection cost", "[memory]") {
  const MemoryPlan plan =
      plan_memory({.dim = 6, .splats = 64'000, .width = 160, .height = 160, .intersections = 1000});
  // Four times 35 parameters, record and its gradient, five words of keys and counts, three of sorting, four
  // of MCMC.
  CHECK(plan.each(MemoryUnit::splat) == 4 * (4 * 35 + 16 + 16 + 5 + 3 + 4));
  CHECK(plan.each(MemoryUnit::intersection) == 4 * 2 + 2 + 64);
  CHECK(plan.largest().bytes == row_stride(64'000) * 35ull * 4);
  const MemoryPlan render = plan_memory(
      {.dim = 6, .splats = 64'000, .width = 160, .height = 160, .intersections = 1000, .training = false});
  CHECK(render.each(MemoryUnit::splat) == 4 * (35 + 16 + 4 + 3));
  CHECK(render.each(MemoryUnit::pixel) == 16);
  CHECK(render.each(MemoryUnit::intersection) == 4);
  CHECK(render.total() < plan.total());
  const MemoryPlan copying =
      plan_memory({.dim = 6, .training = false, .raster = RasterKind::gpu, .sorts_by_copying = true});
  CHECK(copying.each(MemoryUnit::intersection) == 4 + 20);
  CHECK(summary(plan).find("MiB") != std::string::npos);
}

TEST_CASE("bench scenes: the synthetic object has the statistics it promises", "[bench]") {
  for (const auto& device : devices_under_test())
    for (const int dim : {3, 6, 7}) {
      const BenchScene scene = synthetic_object(dim, 30'000, 200, 200, 1);
      const WorkCounts c = StepBench(*device, scene, raster_kind("auto", device->info())).counts();
      INFO("N = " << dim << ": " << c.blended_per_object_pixel() << " blended an object pixel on "
                  << c.object_pixels << " pixels, lanes " << c.lane_utilisation());
      CHECK(c.visible > 29'700);
      CHECK(c.blended_per_object_pixel() == Approx(50).epsilon(0.2));
      CHECK(static_cast<double>(c.object_pixels) / static_cast<double>(c.pixels) ==
            Approx(0.46).epsilon(0.1));
      CHECK(c.lane_utilisation() > 0.3);
      CHECK(c.lane_utilisation() < 0.8);
    }
}

// A least alpha is other kernels for every stage and for whole iterations.
TEST_CASE("bench: approximations reach every case", "[bench]") {
  for (const auto& device : devices_under_test()) {
    const BenchScene scene = synthetic_object(3, 3'000, 100, 70, 1);
    const auto counts = [&](const TrainSettings& settings) {
      return StepBench(*device, scene, RasterKind::cpu, settings).counts();
    };
    const WorkCounts standard = counts({});
    TrainSettings settings;
    settings.alpha_min = 0.1;
    const WorkCounts other = counts(settings);
    CHECK(standard.tiles == 7 * 5);
    CHECK(other.tiles == standard.tiles);
    CHECK(other.intersections < standard.intersections);
    CHECK(other.blended < standard.blended);
    const auto of_iteration = [&](const TrainSettings& work) {
      return measure_iterations(*device, scene, {.limits = {1, 0, 0.01, 1}, .work = work}).intersections;
    };
    CHECK(of_iteration({}) == standard.intersections);
    CHECK(of_iteration(settings) == other.intersections);
  }
}

// Every pair of a list, without the masks.
std::uint64_t blended_by_brute_force(const std::vector<float>& records, const std::vector<std::uint32_t>& ids,
                                     const std::vector<std::uint32_t>& ranges, const ImageShape& shape) {
  std::uint64_t blended = 0;
  for (int y = 0; y < shape.height; ++y)
    for (int x = 0; x < shape.width; ++x) {
      const auto tile = static_cast<std::size_t>(y / 16 * shape.tiles_x() + x / 16);
      double open = 1;
      for (std::uint32_t k = ranges[tile]; k < ranges[tile + 1] && open > 0; ++k) {
        const float* s = &records[ids[k] * std::size_t{kSplatStride}];
        const double dx = s[kSplatX] - (x + 0.5), dy = s[kSplatY] - (y + 0.5);
        const double a = s[kSplatL00] * dx + s[kSplatL01] * dy, b = s[kSplatL11] * dy, r = a * a + b * b;
        if (r >= 1) continue;
        const double next = open * (1 - std::min(0.999, s[kSplatOpacity] * std::pow(1 - r, s[kSplatBeta])));
        open = next > 1e-4 ? next : 0;
        if (open > 0) ++blended;
      }
    }
  return blended;
}

TEST_CASE("bench: work is counted from masks as from everything", "[bench]") {
  for (const auto& device : devices_under_test()) {
    const BenchScene scene = synthetic_object(6, 3'000, 100, 70, 1);
    CaptureStages stages(make_stages(*device, {.dim = 6, .raster = raster_kind("auto", device->info())}));
    const DeviceModel model(*device, scene.model);
    Renderer renderer(*device, stages);
    renderer.set_cameras({scene.views.views[0].camera});
    const ListTotals totals = renderer.forward(model.view(), 0, {}, false);
    const RasterForward& work = stages.last<RasterForward>();
    const WorkCounts c =
        count_work(*device, ParameterLayout(6), 3'000, totals.visible, totals.intersections, work);
    const auto download = [&]<typename T>(const BufferView<T>& view) {
      std::vector<T> values(view.size);
      device->read(*view.memory, 0, std::as_writable_bytes(std::span(values)));
      return values;
    };
    const std::uint64_t expected = blended_by_brute_force(download(work.records), download(work.sorted_ids),
                                                          download(work.tile_ranges), work.shape);
    // Float against double at the rim and at the end of a pixel: observed 0 of 173 064 on PoCL.
    CHECK(static_cast<double>(c.blended) == Approx(static_cast<double>(expected)).epsilon(1e-4));
    CHECK(c.pixels == 7000);
    CHECK(c.active_pairs <= c.intersections);
    const std::vector<std::uint32_t> ranges = download(work.tile_ranges);
    std::uint64_t longest = 0, in_long = 0;
    for (std::size_t t = 0; t < 35; ++t) {  // 7 x 5 tiles
      const std::uint64_t length = ranges[t + 1] - ranges[t];
      longest = std::max(longest, length);
      in_long += 35 * length > 4 * totals.intersections ? length : 0;
    }
    CHECK(c.tiles == 35);
    CHECK(c.longest_list == longest);
    CHECK(c.long_pairs == in_long);
    CHECK(c.mean_list() == Approx(static_cast<double>(totals.intersections) / 35));
  }
}

TEST_CASE("bench: models of another form are measured in that form", "[bench]") {
  const ModelVariant form{.kernel = SpatialKernel::gaussian, .colour = ColourMode::sh1};
  for (const auto& device : devices_under_test()) {
    const RasterKind raster = raster_kind("auto", device->info());
    const BenchScene scene = random_start(3, 2'000, 64, 64, form);
    StepBench bench(*device, scene, raster);
    for (const std::string& stage : step_stages()) CHECK(bench.measure(stage, kOnce).wall_ms.median > 0);
    // As many splats of the Beta kernel reach as far as a deviation, these three.
    const WorkCounts beta = StepBench(*device, random_start(3, 2'000, 64, 64), raster).counts();
    CHECK(bench.counts().blended > 2 * beta.blended);
    // Lanes that a composited splat uses: counted with the other kernel's support it would be far less.
    CHECK(bench.counts().lane_utilisation() > 0.5);
    const IterationMeasurement m = measure_iterations(*device, scene, {.raster = raster, .limits = kOnce});
    CHECK(m.time.wall_ms.median > 0);
  }
}

TEST_CASE("bench: every stage is measured, and the model is left as it was", "[bench]") {
  for (const auto& device : devices_under_test()) {
    const BenchScene scene = synthetic_object(6, 2'000, 64, 48, 2);
    StepBench bench(*device, scene, raster_kind("auto", device->info()));
    const WorkCounts before = bench.counts();
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
    CHECK(bench.counts().blended == before.blended);
    CHECK_THROWS_AS(bench.measure("nothing", kOnce), Error);
  }
}

TEST_CASE("bench: iterations do not move the scene", "[bench]") {
  for (const auto& device : devices_under_test()) {
    const BenchScene scene = synthetic_object(6, 2'000, 64, 64, 1);
    const std::uint64_t before =
        StepBench(*device, scene, raster_kind("auto", device->info())).counts().intersections;
    const IterationMeasurement m = measure_iterations(
        *device, scene, {.raster = raster_kind("auto", device->info()), .limits = {1, 0.5, 30, 40}});
    CHECK(m.time.wall_ms.samples >= 40);  // 200 iterations, with refinements
    CHECK(m.intersections == before);
  }
}

TEST_CASE("bench: ceilings are plausible", "[bench]") {
  for (const auto& device : devices_under_test()) {
    const CeilingRates c = measure_ceilings(*device, true);
    for (const double rate : {c.fma, c.read, c.write, c.update, c.private_cache}) {
      CHECK(rate > 0.01);
      CHECK(rate < 1e6);
    }
  }
}

TEST_CASE("bench: cores are some way apart", "[bench]") {
  const double ns = core_round_trip_ns();
  cpu_set_t cores;
  REQUIRE(sched_getaffinity(0, sizeof cores, &cores) == 0);
  if (CPU_COUNT(&cores) < 2) {
    CHECK(ns == 0);
  } else {
    CHECK(ns > 1);
    CHECK(ns < 1e8);  // 1e7 a pair, and what the scheduler adds
  }
}

// On it a second passes between two looks.
class HurriedTime final : public TimeSource {
 public:
  double seconds() const override { return ++looks; }
  mutable std::atomic<int> looks = 0;
};

TEST_CASE("bench: cores whose time is over are given up", "[bench]") {
  const std::size_t pairs = std::max<std::size_t>(std::thread::hardware_concurrency(), 1) - 1;
  const HurriedTime time;
  core_round_trip_ns(time);
  CHECK(time.looks <= 6 * static_cast<int>(pairs));  // one round of ten, a pair; each takes three looks
}

TEST_CASE("bench: a case that the host has no memory for is a note", "[bench]") {
  bench::RunOptions options;
  options.quick = true;
  options.limits = kOnce;
  options.cases = {{"render", "model", 100, 32, 32},
                   {"render", "synthetic", 100, 32, 32},
                   {"startup_warm", "glossy", 100, 32, 32}};
  options.open_model = []() -> BenchScene { throw std::bad_alloc(); };
  options.executable = "/bin/true";
  options.training.variant.kernel = SpatialKernel::gaussian;
  const DeviceReport report = run_cases("", options);
  REQUIRE(report.results.size() == 3);
  CHECK(report.results[0].note == "out of memory");
  CHECK(report.results[0].wall_ms.samples == 0);
  CHECK(report.results[1].wall_ms.samples > 0);
  CHECK(report.results[1].form == "default");
  CHECK(report.results[2].form == "kernel gaussian");  // not that of the scene before
}

}  // namespace
}  // namespace ubs
