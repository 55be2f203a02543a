// SPDX-License-Identifier: Apache-2.0
// One configuration of the kernels on one device and view: whole passes, single stages on the buffers that a
// pass left, and single stages on exact inputs.
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
  // Uploads the model and runs one iteration; of a forward-only configuration the forward pass. The problem
  // must outlive the object.
  StageRun(Device& device, const KernelConfig& config, const Problem& problem);

  // "forward", "iteration" (forward, loss, backward; no update), or a stage of stage_errors(). Returns when
  // the device is idle.
  void run(const std::string& stage);

  std::vector<float> image() const;     // (3, height, width) of the last pass
  std::vector<float> gradient() const;  // layout of the model
  double loss() const;
  // The gradient with the image gradient given (3, height, width) instead of the loss's own.
  std::vector<float> gradient_of(std::span<const double> v_image);

  // Each stage alone, given the truth of the stages before it rounded to float32. Spoils the buffers: the
  // next pass makes them anew. Lists are part of the forward rasteriser, the sum over tiles part of the
  // backward one. Forward only: projection and forward rasteriser.
  std::vector<StageErrors> stage_errors(const StageTruth& truth);

  // The end of a step, given the truth of the stages before it: for Stages::learn.
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
  void write_planes(BufferView<float> to, std::span<const float> planes);  // pads
  std::vector<float> read_planes(BufferView<float> from) const;            // crops

  Device& device_;
  const Problem& problem_;
  CaptureStages stages_;
  DeviceModel model_;
  Renderer renderer_;
  RenderSettings settings_;
  Buffer<float> target_, sums_, v_params_;
};

}  // namespace ubs::check
