// SPDX-License-Identifier: Apache-2.0
// find_nonfinite_source() finds out in which stage a value that is not finite occurred first. It repeats the
// forward and backward passes of the iteration, and checks the output of each stage. Training only calls it
// after such a value was detected, to report its source.
#pragma once

#include <cstdint>
#include <string_view>

#include "host/train/train_state.hpp"
#include "host/train/training_views.hpp"

namespace ubs {

struct NonFiniteSource {
  // The first stage whose output is not finite. "parameters" means that the parameters were not finite before
  // the iteration, "adam" that everything is finite up to the gradients, and "unknown" that the passes could
  // not be repeated.
  std::string_view stage;
  std::int64_t view = -1;  // index of the training view; -1: unknown, or several views
};

// `state` is the state after the iteration. The Adam step of this iteration has not changed the parameters
// whose new values would not be finite, so such values usually occur again when the passes are repeated. The
// other parameters have been changed by one step. The views must have the same size as in the iteration.
NonFiniteSource find_nonfinite_source(Device& device, Stages& stages, TrainingViews& views,
                                      const RenderSettings& settings, const TrainState& state);

}  // namespace ubs
