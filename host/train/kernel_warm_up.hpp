// SPDX-License-Identifier: Apache-2.0
// KernelWarmUp does everything that a training does on its device, once, on a model of its own. OpenCL
// drivers compile a kernel when it is first launched, which takes memory, disk and seconds: better before the
// first step than at the first relocation, hours later.
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
  // On `view`, which must have an image, and a copy of `model`, which is grown if training grows it.
  KernelWarmUp(Device& device, const TrainSettings& settings, const View& view, const SplatModel& model);

  Stages& stages() { return *stages_; }
  // A step in every form that training knows, relocation, growth and noise, through `stages`: its own or what
  // records them.
  void learn(Stages& stages);
  // An evaluation of the view, as training does it or with `more`.
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

// The model with `target` splats, as relocation and growth leave copies (docs/method.md 4.3): the light that
// passes all of them is what passed the one.
SplatModel copies(const SplatModel& model, std::size_t target);

// What a view with its gradient takes on this device: for comparing devices, so that large models are cut.
double view_seconds(Device& device, const TrainSettings& settings, const Split& train,
                    const SplatModel& model);

// Has the device compile every kernel that training these splits from `initial` can launch, and measuring the
// result with `more`. Throws what the first steps would, and Error(memory) where what comes later certainly
// does not fit.
void build_kernels(Device& device, const TrainSettings& settings, const Split& train, const Split& test,
                   const SplatModel& initial, ImageMetrics* more = nullptr);

}  // namespace ubs
