// SPDX-License-Identifier: Apache-2.0
// StepBench measures the times of the single stages of a training step. The buffers contain the results of a
// complete step, so each stage has realistic inputs.
#pragma once

#include <string>
#include <vector>

#include "host/lab/bench/bench_scene.hpp"
#include "host/lab/bench/operation.hpp"
#include "host/pipeline/capture_stages.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/renderer.hpp"
#include "host/settings/train_settings.hpp"

namespace ubs::bench {

class StepBench {
 public:
  // Uploads the scene and runs one step on its first view. The scene must outlive the object. Only
  // kernel_assignments() of `training` are used.
  StepBench(Device& device, const BenchScene& scene, RasterKind raster, const TrainSettings& training = {});

  // `stage` is one of step_stages(), or "forward_backward".
  Measured measure(const std::string& stage, const SamplingLimits& limits);

  // Runs a stage `calls` times and returns the wall time per call. The stage must have run before.
  double time_ms(const std::string& stage, int calls) { return timed_ms(device_, repeated(stage), calls); }
  // Returns the results of the step: the image, followed by the gradient of each trained parameter row.
  std::vector<std::vector<float>> outputs() const;

  const ListTotals& totals() const { return totals_; }      // totals of the view that the step rendered
  std::uint64_t peak_bytes() const { return peak_bytes_; }  // peak memory of the step and a refinement

 private:
  Repeated repeated(const std::string& stage);
  void step();
  void restore_model();  // restores the parameters of the scene
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
