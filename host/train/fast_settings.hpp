// SPDX-License-Identifier: Apache-2.0
// The settings of a training that gets along with fewer than the published 30 000 iterations
// (docs/budget.md).
#pragma once

#include <array>
#include <optional>

#include "host/scene/train_settings.hpp"

namespace ubs {

// What fast runs start from: higher rates, directions that begin wide, coarse images first.
// data_specs/fast.yaml holds the same.
TrainSettings fast_settings();

// The opacity penalty for views that are parts of wide images. An iteration trains one view, and the penalty
// acts on all splats. Views that look in all directions leave most splats without a gradient, so that they
// fade.
inline constexpr double kWideOpacityReg = 0;

// What the training pictures say about the settings.
struct PictureFacts {
  std::size_t random_points = SIZE_MAX;  // more splats than that are not drawn at random
  bool lone_object = false;              // nothing is to be seen behind what they show
  bool few_photographs = false;          // which are soon learnt by heart
  bool wide_images = false;              // views are parts of them
};

// Returns the settings of a run of so many iterations that starts with `initial` splats, 0 where they are
// drawn at random: rates, most splats, refinement and growth. What differs from fast_settings(), or what
// TrainSettings::chosen names, is somebody's choice and stays.
TrainSettings fast_settings_for(const TrainSettings& settings, int iterations, std::size_t initial,
                                const PictureFacts& pictures = {});
// Returns how many splats such a run starts with.
std::size_t first_splats(const TrainSettings& settings, std::size_t initial);
// Returns how many splats such a run ends with, unless cap_max says otherwise. `moving`: of the direct form
// with time.
int fast_run_splats(int iterations, std::size_t initial, bool moving);

}  // namespace ubs
