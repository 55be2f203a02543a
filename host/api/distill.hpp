// SPDX-License-Identifier: Apache-2.0
// Distiller converts a model at a fixed time to Gaussians with spherical harmonics whose images resemble
// those of the model. It starts from the closed form (reduce_splats.hpp) and trains it on images that the
// model itself renders for the given cameras, each in front of a random colour. So the Gaussians become
// transparent where the model is transparent, and resemble it in front of any background.
#pragma once

#include <functional>
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
  ImportedSplats splats;  // the closed form if the training was declined or did not improve it
  int iterations = 0;     // 0: the training was declined
  double seconds = 0;     // for measuring, rendering and training
  // PSNR of closed form and result against renders of the model in front of its own background, mean over a
  // few of the cameras [dB].
  double before = 0, after = 0;
};

// What Distiller is going to do.
struct DistillPlan {
  std::size_t renders = 0;  // number of images that the model has rendered for the training
  int iterations = 0;
  double seconds = 0;  // expected time of the training
};

class Distiller {
 public:
  // Uses the cameras of `views`, not their images. `drawing` are the settings for rendering the model. The
  // result has harmonics of degree `degree`.
  Distiller(std::shared_ptr<Device> device, const MixedModel& model, TrainSettings drawing, Split views,
            int degree);
  // Converts the model at this time. Takes about `seconds`, but trains for at least kMinIterations. Calls
  // `start` before training, which may return false to decline it.
  Distilled at(double time, const ImportedSplats& closed_form, double seconds,
               const std::function<bool(const DistillPlan&)>& start);

 private:
  // Renders the views until `seconds` have passed, but at least kLeastRenders of them.
  Split renders(double time, double seconds);
  // Renders a few of the views in front of the background of the settings.
  Split test_renders(double time);

  std::shared_ptr<Device> device_;
  const MixedModel& model_;
  TrainSettings drawing_;
  Split views_;  // in an order in which the first views of any number are far apart
  int degree_;
  std::vector<StepCost> costs_;  // measured once, reused for further times
};

}  // namespace ubs
