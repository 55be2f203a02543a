// SPDX-License-Identifier: Apache-2.0
// After a value that is not finite: the passes of the iteration again, stage by stage, on the model before
// it.
#pragma once

#include "host/train/guard.hpp"
#include "host/train/training_views.hpp"

namespace ubs {

// Fills stage, where, view, gradient and model of the event, whose iteration the views must be at the level
// of. `rates`: of the parameter rows at the last step, which is undone.
void find_cause(Device& device, Stages& stages, TrainingViews& views, const RenderSettings& settings,
                std::vector<float> rates, const TrainState& state, NonFiniteEvent& event);

}  // namespace ubs
