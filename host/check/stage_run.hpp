// SPDX-License-Identifier: Apache-2.0
// StageRun runs one configuration of the kernels on one device and view: whole passes, single stages on the
// buffers that a pass left, and single stages on exact inputs.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "host/check/error_norms.hpp"
#include "host/check/stage_truth.hpp"
#include "host/pipeline/capture_stages.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/renderer.hpp"

namespace ubs::check {

struct StageErrors {
  std::string stage;
  std::vector<NamedErrors> quantities;
};

class StageRun {
 public:
  // Uploads the model and runs one iteration, or only the forward pass if the configuration is forward-only.
  // `problem` must outlive the object.
  StageRun(Device& device, const KernelConfig& config, const Problem& problem);

  // Runs "forward", "iteration" (forward, loss, backward; no update), or a stage that stage_errors() reports.
  // Returns when the device is idle.
  void run(const std::string& stage);

  std::vector<float> image() const;     // (3, height, width) of the last pass
  std::vector<float> gradient() const;  // in the layout of the model
  double loss() const;
  // Returns the gradient for the given image gradient (3, height, width) instead of that of the loss.
  std::vector<float> gradient_of(std::span<const double> v_image);

  // Runs each stage alone, with the exact results of the previous stages, rounded to float32, as input.
  // Returns the errors of each stage. Lists are part of the forward rasteriser, and the sum over tiles is
  // part of the backward rasteriser. Forward-only configurations have only projection and forward rasteriser.
  // At the end a whole pass restores the buffers.
  std::vector<StageErrors> stage_errors(const StageTruth& truth);

  // Returns the end of a step with exact results of the previous stages as input, for Stages::learn.
  ProjectBackward given_to_projection(const StageTruth& truth);
  Stages& stages() { return stages_.real(); }
  const DeviceModel& model() const { return model_; }

 private:
  void run_whole();
  void iteration();
  StageErrors projection_errors(const StageTruth& truth);
  StageErrors raster_forward_errors(const StageTruth& truth);
  StageErrors loss_errors(const StageTruth& truth);
  StageErrors raster_backward_errors(const StageTruth& truth);
  StageErrors project_backward_errors(const StageTruth& truth);
  void write_planes(BufferView<float> to, std::span<const float> planes);  // pads the planes
  std::vector<float> read_planes(BufferView<float> from) const;            // crops the planes

  Device& device_;
  const Problem& problem_;
  CaptureStages stages_;
  DeviceModel model_;
  Renderer renderer_;
  RenderSettings settings_;
  Buffer<float> target_, sums_, v_params_;
};

}  // namespace ubs::check
