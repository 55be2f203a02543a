// SPDX-License-Identifier: Apache-2.0
// Times of the single stages of a training step on the state that a real step left behind.
#pragma once

#include <string>
#include <vector>

#include "host/lab/bench/bench_scene.hpp"
#include "host/lab/bench/operation.hpp"
#include "host/pipeline/capture_stages.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/renderer.hpp"
#include "host/scene/train_settings.hpp"

namespace ubs::bench {

class StepBench {
 public:
  // Uploads the scene and does one step on its first view. The scene must outlive the object. Of `training`
  // only kernel_assignments() are looked at.
  StepBench(Device& device, const BenchScene& scene, RasterKind raster, const TrainSettings& training = {});

  // `stage`: of step_stages(), or "forward_backward".
  Measured measure(const std::string& stage, const SamplingLimits& limits);

  // Wall time a call of some calls of a stage, which has run before.
  double time_ms(const std::string& stage, int calls) { return timed_ms(device_, repeated(stage), calls); }
  // Of the step: the image, then the gradient of each parameter row that is learnt.
  std::vector<std::vector<float>> outputs() const;

  const ListTotals& totals() const { return totals_; }      // of the step's view
  std::uint64_t peak_bytes() const { return peak_bytes_; }  // of the step

 private:
  Repeated repeated(const std::string& stage);
  void step();
  void restore_model();  // to the state before the step, with two per cent dead splats
  void save_model();

  Device& device_;
  const BenchScene& scene_;
  KernelConfig config_;
  CaptureStages stages_;
  DeviceModel model_;
  Renderer renderer_;
  RenderSettings settings_;
  std::uint32_t grown_;
  Buffer<float> v_params_, moment1_, moment2_, learning_rates_, sums_;
  Buffer<std::uint8_t> target_;
  Buffer<float> saved_, dead_opacities_;
  ListTotals totals_;
  std::uint64_t peak_bytes_ = 0;
};

}  // namespace ubs::bench
