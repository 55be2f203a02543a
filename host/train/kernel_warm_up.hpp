// SPDX-License-Identifier: Apache-2.0
// KernelWarmUp executes every operation of a training once, on a copy of a model. OpenCL drivers compile a
// kernel when it is first launched, which takes memory, disk space and seconds. The warm-up moves this to the
// start of the run. Otherwise a failure might not appear until a relocation hours later.
#pragma once

#include <memory>
#include <vector>

#include "host/device/stages.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/image_metrics.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/train_settings.hpp"
#include "host/train/target_images.hpp"

namespace ubs {

class KernelWarmUp {
 public:
  // Prepares the warm-up for `view`, which must have an image, and for a copy of `model`. The copy grows if
  // training grows the model.
  KernelWarmUp(Device& device, const TrainSettings& settings, const View& view, const SplatModel& model);

  Stages& stages() { return *stages_; }
  // Executes every variant of a training step, and relocation, growth and noise, on `stages`. These are
  // stages() or an object that records the calls to it.
  void learn(Stages& stages);
  // Evaluates the view as training does, with the additional metrics of `more` if it is given.
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

// Returns the model with `target` splats, which are copies of the original ones as relocation and growth
// create them (docs/method.md 4.3): the opacities are reduced, so that all copies of a splat together
// transmit as much light as the original splat.
SplatModel copies(const SplatModel& model, std::size_t target);

// Returns the seconds that one view with its gradient takes on this device. This serves to compare devices,
// so at most 200 000 splats are used.
double view_seconds(Device& device, const TrainSettings& settings, const Split& train,
                    const SplatModel& model);

// Makes the device compile every kernel that can be launched by training these splits from `initial`, and by
// measuring the result with `more`. Throws the errors that the first steps would throw, and Error(memory) if
// a later part of the training certainly does not fit into memory.
void build_kernels(Device& device, const TrainSettings& settings, const Split& train, const Split& test,
                   const SplatModel& initial, ImageMetrics* more = nullptr);

}  // namespace ubs
