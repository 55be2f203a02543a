// SPDX-License-Identifier: Apache-2.0
// A model as Gaussians with harmonics that look like it: trained on the pictures that the model itself makes
// of the cameras, from its closed form (reduce_splats.hpp) on, for a stated time.
#pragma once

#include <memory>
#include <optional>

#include "host/data/imported_splats.hpp"
#include "host/device/device.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/mixed_model.hpp"
#include "host/scene/train_settings.hpp"
#include "host/train/time_budget.hpp"

namespace ubs {

inline constexpr double kGaussianBlur = 0.3;  // eps2d that other tools draw Gaussians with

struct Distilled {
  ImportedSplats splats;
  int iterations = 0;
  double seconds = 0;            // measuring, drawing and training
  double before = 0, after = 0;  // PSNR of closed form and result against the model's pictures [dB]
};

class Distiller {
 public:
  // The cameras of `views`, whose images are not looked at; `drawing`: how the model is drawn. The form has
  // harmonics of this degree.
  Distiller(std::shared_ptr<Device> device, const MixedModel& model, TrainSettings drawing, Split views,
            int degree);
  // At this time of a dynamic model, in about so many seconds, but at least kMinIterations.
  Distilled at(double time, const ImportedSplats& closed_form, double seconds);

 private:
  Split pictures(double time);

  std::shared_ptr<Device> device_;
  const MixedModel& model_;
  TrainSettings drawing_;
  Split views_;
  int degree_;
  std::vector<StepCost> costs_;  // measured once
};

}  // namespace ubs
