// SPDX-License-Identifier: Apache-2.0
// fast_settings() returns the settings for trainings with fewer than the published 30 000 iterations, and
// fast_settings_for() adapts them to the number of iterations and to the data (docs/budget.md).
#pragma once

#include <array>
#include <optional>

#include "host/scene/train_settings.hpp"

namespace ubs {

// Returns the settings that fast runs start from: higher learning rates, splats that are visible from a wide
// range of directions at first, and coarse images at the start of the run. data_specs/fast.yaml contains the
// same values.
TrainSettings fast_settings();

// The weight of the opacity penalty if the views are parts of wide images. Each iteration trains one view,
// but the penalty acts on all splats. If the views look in all directions, most splats get no gradient in an
// iteration, and the penalty would make them fade.
inline constexpr double kWideOpacityReg = 0;

// PictureFacts holds properties of the training images that influence the settings.
struct PictureFacts {
  std::size_t random_points = SIZE_MAX;  // maximum number of splats that are placed at random
  bool lone_object = false;              // the images show an object in front of a plain background
  bool few_photographs = false;          // a small number of images, which a model overfits quickly
  bool wide_images = false;              // the views are parts of wide images
  std::size_t views = 0;                 // number of training views; 0: unknown
  double pixels = 0;                     // median number of pixels of a view; 0: unknown
};

// Returns the settings of a run of `iterations` iterations that starts with `initial` splats (0: they are
// placed at random). It sets learning rates, the maximum number of splats, the image pyramid, refinement and
// growth. Values that differ from the default schedule, and the settings named in TrainSettings::chosen, were
// chosen by the user and are not changed.
TrainSettings fast_settings_for(const TrainSettings& settings, int iterations, std::size_t initial,
                                const PictureFacts& pictures = {});
// Returns the number of splats that such a run starts with.
std::size_t first_splats(const TrainSettings& settings, std::size_t initial);
// Returns the number of splats that such a run ends with, unless cap_max limits it.
int fast_run_splats(int iterations, std::size_t initial);

}  // namespace ubs
