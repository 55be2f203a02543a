// SPDX-License-Identifier: Apache-2.0
// Distiller converts a model at a fixed time to Gaussians with spherical harmonics whose images resemble
// those of the model. It starts from the closed form (reduce_splats.hpp) and trains it on images that the
// model itself renders for the given cameras.
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

inline constexpr double kGaussianBlur = 0.3;  // eps2d with which other tools render Gaussians

struct Distilled {
  ImportedSplats splats;
  int iterations = 0;
  double seconds = 0;            // for measuring, rendering and training
  double before = 0, after = 0;  // PSNR of closed form and result against the images of the model [dB]
};

class Distiller {
 public:
  // Uses the cameras of `views`, not their images. `drawing` are the settings for rendering the model. The
  // result has harmonics of degree `degree`.
  Distiller(std::shared_ptr<Device> device, const MixedModel& model, TrainSettings drawing, Split views,
            int degree);
  // Converts the model at this time. Takes about `seconds`, but trains for at least kMinIterations.
  Distilled at(double time, const ImportedSplats& closed_form, double seconds);

 private:
  Split pictures(double time);

  std::shared_ptr<Device> device_;
  const MixedModel& model_;
  TrainSettings drawing_;
  Split views_;
  int degree_;
  std::vector<StepCost> costs_;  // measured once, reused for further times
};

}  // namespace ubs
