// SPDX-License-Identifier: Apache-2.0
#include "host/lab/bench/tune_subject.hpp"

#include "host/base/error.hpp"
#include "host/lab/bench/step_bench.hpp"

namespace ubs::bench {
namespace {

class DeviceSubject final : public TuneSubject {
 public:
  // The values to be tried must already be set on the device, because the kernels are compiled here.
  DeviceSubject(Device& device, const BenchScene& scene, RasterKind raster) : step_(device, scene, raster) {}

  Parts outputs() override { return step_.outputs(); }
  double time_ms(const std::string& stage, int calls) override { return step_.time_ms(stage, calls); }

 private:
  StepBench step_;
};

}  // namespace

BenchScene tuning_scene(const DeviceInfo& device, bool quick) {
  if (quick) return synthetic_object(6, 3'000, 64, 64, 1);
  if (device.type == DeviceType::gpu) return synthetic_object(6, 300'000, 800, 800, 1);
  return synthetic_object(6, 100'000, 400, 400, 1);
}

TuningValues tune(Device& device, const BenchScene& scene, const TuneOptions& options) {
  TunableDevice* const tunable = device.tunable();
  if (!tunable) fail(ErrorKind::usage, "{} has nothing to tune", device.info().name);
  const auto make = [&](const TuningValues& values) {
    tunable->set_tuning(values);
    return std::make_unique<DeviceSubject>(device, scene, options.raster);
  };
  TuningValues values = choose_values(tunable->tuned_constants(), make, options);
  tunable->set_tuning(values);
  return values;
}

}  // namespace ubs::bench
