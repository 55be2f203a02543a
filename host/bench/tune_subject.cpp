// SPDX-License-Identifier: Apache-2.0
#include "host/bench/tune_subject.hpp"

#include <optional>

#include "host/base/error.hpp"
#include "host/bench/step_bench.hpp"
#include "host/bench/training_bench.hpp"

namespace ubs::bench {
namespace {

class DeviceSubject final : public TuneSubject {
 public:
  DeviceSubject(Device& device, TunableDevice& tunable, const BenchScene& scene, RasterKind raster,
                TuningValues values)
      : device_(device), tunable_(tunable), scene_(scene), raster_(raster), values_(std::move(values)) {
    tunable_.set_tuning(values_);
    step_.emplace(device, scene, raster, training_);
  }

  Parts outputs() override { return step_->outputs(); }
  double time_ms(const std::string& stage, int calls) override {
    if (stage != "iteration") return step_->time_ms(stage, calls);
    if (!iteration_) {
      tunable_.set_tuning(values_);  // those of the last subject are in force
      iteration_.emplace(device_, scene_, IterationOptions{.raster = raster_, .work = training_});
    }
    return iteration_->time_ms(calls);
  }

 private:
  Device& device_;
  TunableDevice& tunable_;
  const BenchScene& scene_;
  RasterKind raster_;
  TuningValues values_;
  TrainSettings training_;
  std::optional<StepBench> step_;
  std::optional<IterationBench> iteration_;
};

}  // namespace

BenchScene tuning_scene(const DeviceInfo& device, bool quick) {
  if (quick) return synthetic_object(6, 3'000, 64, 64, 1);
  if (device.backend == "cuda") return synthetic_object(6, 300'000, 800, 800, 1);
  return synthetic_object(6, 100'000, 400, 400, 1);
}

TuningValues tune(Device& device, const BenchScene& scene, const TuneOptions& options) {
  auto* tunable = dynamic_cast<TunableDevice*>(&device);
  if (!tunable) fail(ErrorKind::usage, "{} has nothing to tune", device.info().name);
  const auto make = [&](const TuningValues& values) {
    return std::make_unique<DeviceSubject>(device, *tunable, scene, options.raster, values);
  };
  TuningValues values = choose_values(tunable->tuned_constants(), make, options);
  tunable->set_tuning(values);
  return values;
}

}  // namespace ubs::bench
