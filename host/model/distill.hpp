// SPDX-License-Identifier: Apache-2.0
// Distiller converts a model at a fixed time to Gaussians with spherical harmonics whose images resemble
// those of the model. It starts from the closed form (reduce_splats.hpp) and trains it on images that the
// model itself renders for the given cameras, each in front of a random colour. Because of the random
// colours, the Gaussians become transparent where the model is transparent, and resemble the model in front
// of any background.
#pragma once

#include <functional>
#include <memory>
#include <optional>

#include "host/device/device.hpp"
#include "host/formats/imported_splats.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/mixed_model.hpp"
#include "host/settings/train_settings.hpp"
#include "host/train/time_budget.hpp"

namespace ubs {

inline constexpr double kGaussianBlur = 0.3;  // eps2d with which other tools render Gaussians

struct Distilled {
  ImportedSplats splats;  // the closed form if training was declined or did not improve it
  int iterations = 0;     // number of training iterations, or 0 if training was declined
  double seconds = 0;     // time that measuring, rendering and training took together
  // PSNR [dB] of the images of the closed form (`before`) and of the trained Gaussians (`after`), compared
  // with images of the model in front of its own background. It is the mean over a few of the cameras.
  double before = 0, after = 0;
};

// A DistillPlan describes the training run that Distiller is about to start.
struct DistillPlan {
  std::size_t renders = 0;  // number of images of the model that the Gaussians are trained on
  int iterations = 0;       // number of training iterations
  double seconds = 0;       // expected training time
};

class Distiller {
 public:
  // Uses only the cameras of `views`, not their images. `drawing` contains the settings for rendering the
  // model. The resulting Gaussians have spherical harmonics of degree `degree`.
  Distiller(std::shared_ptr<Device> device, const MixedModel& model, TrainSettings drawing, Split views,
            int degree);
  // Converts the model at the time `time`. Takes about `seconds`, or longer if kMinIterations iterations of
  // training need more time. Calls `start` before the training. If `start` returns false, the training is
  // skipped and the result is the closed form.
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
  Split views_;  // ordered so that the first k views are far apart, for every k
  int degree_;
  std::vector<StepCost> costs_;  // measured once, reused for further times
};

}  // namespace ubs
