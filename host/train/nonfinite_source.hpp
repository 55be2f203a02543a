// SPDX-License-Identifier: Apache-2.0
// find_nonfinite_source() repeats the passes of an iteration in which a value was not finite, and checks the
// output of each stage until one is not finite. Training calls it only after such a value, to report where
// the value came from.
#pragma once

#include <cstdint>
#include <string_view>

#include "host/train/train_state.hpp"
#include "host/train/training_views.hpp"

namespace ubs {

struct NonFiniteSource {
  // The first stage whose output is not finite. "parameters": the parameters were not finite before the
  // iteration. "adam": everything is finite up to the gradients. "unknown": the passes could not be repeated.
  std::string_view stage;
  std::int64_t view = -1;  // the training view; -1: none in particular
};

// `state` is the state after the iteration. The watched Adam step has not changed the splats whose values are
// not finite, so these values occur again. The other splats have moved by one step. The views must have the
// same size as in the iteration.
NonFiniteSource find_nonfinite_source(Device& device, Stages& stages, TrainingViews& views,
                                      const RenderSettings& settings, const TrainState& state);

}  // namespace ubs
