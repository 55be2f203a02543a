// SPDX-License-Identifier: Apache-2.0
// StageRun runs one configuration of the kernels on one device for one view. It can run whole passes, and
// single stages either on the buffers that the last pass has written or on exact inputs.
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
  // Uploads the model and runs one iteration, or only the forward pass if the configuration has no backward
  // pass. `problem` must outlive the object.
  StageRun(Device& device, const KernelConfig& config, const Problem& problem);

  // Runs the forward pass if `stage` is "forward", or an iteration without the update of the parameters
  // (forward pass, loss, backward pass) if it is "iteration". Otherwise runs the stage with this name, which
  // is one of the names in stage_errors(). Returns when the device is idle.
  void run(const std::string& stage);

  std::vector<float> image() const;     // image of the last pass (3, height, width)
  std::vector<float> gradient() const;  // gradient of the last pass, in the layout of the model
  double loss() const;
  // Returns the gradient of the parameters that belongs to the gradient `v_image` of the image (3, height,
  // width).
  std::vector<float> gradient_of(std::span<const double> v_image);

  // Runs each stage separately and returns its errors. The input of a stage are the exact results of the
  // previous stages, rounded to float32. The lists belong to the stage of the forward rasteriser, and the sum
  // over tiles to the stage of the backward rasteriser. Configurations without a backward pass have only two
  // stages: the projection and the forward rasteriser. Finally runs a whole pass, which restores the buffers.
  std::vector<StageErrors> stage_errors(const StageTruth& truth);

  // Writes the exact results of the previous stages to the input of the backward projection, and returns the
  // arguments of this operation.
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
