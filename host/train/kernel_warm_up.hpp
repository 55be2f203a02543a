// SPDX-License-Identifier: Apache-2.0
// KernelWarmUp executes every operation of training once, on a copy of a model. OpenCL drivers compile a
// kernel when it is first launched, which takes memory, disk space and seconds. The warm-up makes this happen
// at the start of the run. Without it, a failed compilation might not be noticed until a relocation hours
// later.
#pragma once

#include <memory>
#include <vector>

#include "host/device/stages.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/image_metrics.hpp"
#include "host/scene/dataset.hpp"
#include "host/settings/settle.hpp"
#include "host/train/target_images.hpp"

namespace ubs {

class KernelWarmUp {
 public:
  // Prepares the warm-up for `view`, which must have an image, and for a copy of `model`. If training adds
  // splats, the warm-up also adds a splat to this copy.
  KernelWarmUp(Device& device, const TrainSettings& settings, const View& view, const SplatModel& model);

  Stages& stages() { return *stages_; }
  // Executes every kind of training step that the settings can lead to, and relocation, growth and noise, on
  // `stages`. This must be stages(), or an object that forwards calls to it and records them.
  void learn(Stages& stages);
  // Evaluates the view as training does. If `more` is not null, its additional metrics are computed too.
  void evaluate(ImageMetrics* more);

 private:
  Device& device_;
  const TrainSettings& settings_;
  Split view_;
  std::unique_ptr<Stages> stages_;
  DeviceModel model_;
  TargetImages targets_;
  Buffer<float> v_params_, moment1_, moment2_, sums_, rates_;
  Buffer<std::uint32_t> sentinel_;
};

// Returns a model with `target` splats, which are copies of the splats of `model`. The copies are like those
// of relocation and growth (docs/method.md 4.3): their opacities are reduced, so that all copies of a splat
// together transmit as much light as the original splat. If `target` is smaller than the number of splats of
// `model`, the result only contains the first splats, and their opacities are increased accordingly.
SplatModel copies(const SplatModel& model, std::size_t target);

// Returns the seconds that KernelWarmUp::learn() takes on this device with the first view of `train`. This is
// the minimum of several measurements. The result is only used to compare devices, so at most 200 000 splats
// are measured.
double view_seconds(Device& device, const Plan& plan, const Split& train, const SplatModel& model);

// Makes the device compile every kernel that training with these splits and the initial model `initial` can
// launch, including the evaluation with `more`. Throws the same errors as the first training steps, and
// Error(memory) if a later part of training certainly does not fit into memory.
void build_kernels(Device& device, const Plan& plan, const Split& train, const Split& test,
                   const SplatModel& initial, ImageMetrics* more = nullptr);

}  // namespace ubs
