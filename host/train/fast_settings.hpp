// SPDX-License-Identifier: Apache-2.0
// fast_settings() returns the settings for training runs with fewer than the published 30 000 iterations, and
// fast_settings_for() adapts them to the number of iterations and to the data (docs/budget.md).
#pragma once

#include <array>
#include <optional>

#include "host/scene/train_settings.hpp"

namespace ubs {

// Returns the settings on which fast runs are based. Compared with the published settings, learning rates are
// higher, splats are initially visible from a wider range of directions, and the run starts with reduced
// images. data_specs/fast.yaml contains the same values.
TrainSettings fast_settings();

// The weight of the opacity penalty if the views are parts of wide images. Each iteration trains one view,
// but the penalty acts on all splats. If the views look in all directions, most splats get no gradient in an
// iteration, and the penalty would make them fade.
inline constexpr double kWideOpacityReg = 0;

// PictureFacts holds properties of the training images that influence the settings.
struct PictureFacts {
  std::size_t random_points = SIZE_MAX;  // maximum number of random initial splats
  bool lone_object = false;              // the images show an object in front of a plain background
  bool few_photographs = false;          // there are so few images that a model overfits them
  bool wide_images = false;              // the views are parts of wide images
  std::size_t views = 0;                 // number of training views; 0: unknown
  double pixels = 0;                     // median number of pixels of a view; 0: unknown
};

// Returns the settings of a run of `iterations` iterations. `initial` is the number of initial points; 0
// means that the initial splats are placed at random. The function sets the learning rates, the opacity
// penalty, the initial and the maximum number of splats, the image pyramid, the refinement interval and the
// growth. It does not change settings that the user has chosen: those whose value differs from the default,
// and those in TrainSettings::chosen.
TrainSettings fast_settings_for(const TrainSettings& settings, int iterations, std::size_t initial,
                                const PictureFacts& pictures = {});
// Returns the number of splats at the start of a run with these settings and `initial` initial points.
std::size_t first_splats(const TrainSettings& settings, std::size_t initial);
// Returns the maximum number of splats that suits a run of `iterations` iterations with `initial` initial
// points. fast_settings_for() reduces cap_max to this number.
int fast_run_splats(int iterations, std::size_t initial);

}  // namespace ubs
