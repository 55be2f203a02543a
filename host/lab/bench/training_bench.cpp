// SPDX-License-Identifier: Apache-2.0
#include "host/lab/bench/training_bench.hpp"

#include <algorithm>

#include "host/lab/bench/cpu_clock.hpp"
#include "host/settings/fields.hpp"
#include "host/train/run_settings.hpp"

namespace ubs::bench {
namespace {

constexpr int kSampleIterations = 5, kWarmUpSamples = 2, kProfiledSamples = 2;
// Learning rate of positions. It is tiny instead of 0, because this rate decays exponentially between two
// positive values.
constexpr double kFrozenRate = 1e-12;

double all_device_ms(const Device& device) {
  double total = 0;
  for (const TimerEntry& entry : device.timings()) total += entry.device_ms;
  return total;
}

Plan frozen_training(const BenchScene& scene, const IterationOptions& options) {
  TrainSettings s;
  s.dim = scene.model.dim;
  s.variant = scene.model.variant;
  s.iterations = 30000;
  s.init_points = s.cap_max = static_cast<int>(scene.model.count);
  s.schedule = ScheduleKind::published;
  s.refine = {0, 25000, 100};
  s.raster = options.raster == RasterKind::cpu ? "cpu" : "gpu";
  s.log_every = kSampleIterations;
  s.list_counts = options.list_counts;
  s.on_nan = options.guard ? OnNan::stop : OnNan::off;
  s.lr_xyz = s.lr_xyz_final = kFrozenRate;
  s.lr_mean = s.lr_rgb = s.lr_opacity = s.lr_beta = s.lr_scale = s.lr_l_triangle = 0;
  for (std::size_t c = 0; c < 3; ++c) s.background.colour[c] = scene.background[c];
  const auto fields = bind_fields(s, train_fields());
  for (const std::string& assignment : kernel_assignments(options.work))
    set_field(fields, assignment, "benchmark");
  if (!s.freeze.empty()) s.refine.end = 0;
  return settle(s);
}

}  // namespace

IterationMeasurement measure_iterations(Device& device, const BenchScene& scene,
                                        const IterationOptions& options) {
  device.reset_peak();
  const Split none{"test", {}};
  Trainer trainer(device, frozen_training(scene, options), scene.views, none, scene.model);
  int samples = 0;
  const auto skip = [&](int count) {
    samples = 0;
    trainer.run([&](const StepReport& report) { return !report.loss || ++samples < count; });
  };
  // Run until every view has been used once, because the first use of an image uploads it.
  const int epoch = static_cast<int>(scene.views.views.size()) / kSampleIterations + 1;
  skip(std::max(kWarmUpSamples, epoch));
  Sampler sampler(options.limits);
  const double processor = cpu_ms();
  double before = trainer.seconds();
  trainer.run([&](const StepReport& report) {
    if (!report.loss) return true;  // a sample ends when the loss is read, because then all work is complete
    sampler.add(1e3 * (report.seconds - before) / kSampleIterations);
    before = report.seconds;
    return !sampler.enough();
  });
  IterationMeasurement result;
  result.time.wall_ms = sampler.summary();
  result.time.cpu_ms =
      (cpu_ms() - processor) / (kSampleIterations * static_cast<double>(result.time.wall_ms.samples));
  result.peak_bytes = device.peak_bytes();
  result.predicted_bytes = trainer.memory_plan().total();
  result.intersections = trainer.scene().intersections().last;
  device.set_profiling(true);
  skip(kProfiledSamples);
  result.time.device_ms = all_device_ms(device) / (kProfiledSamples * kSampleIterations);
  device.set_profiling(false);
  return result;
}

}  // namespace ubs::bench
