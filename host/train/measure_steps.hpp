// SPDX-License-Identifier: Apache-2.0
// measure_steps() measures how long training steps take on this device. The steps change a copy of the model,
// which is discarded afterwards.
#pragma once

#include <vector>

#include "host/scene/dataset.hpp"
#include "host/train/time_budget.hpp"
#include "host/train/trainer.hpp"

namespace ubs {

// Returns a plan for measuring the time of the training steps of `plan`. A run with the returned plan does
// not refine, so its number of splats, which must be at most `most`, stays the same. It has so many
// iterations that the measurement never reaches its end.
Plan measuring_plan(const Plan& plan, std::size_t most);

// Returns the milliseconds per step for each level of the image pyramid, for steps that start from `state`.
// Each value is the mean of several steps with different views. `trainer` must have been created with
// measuring_plan().
std::vector<double> step_times(Trainer& trainer, const Split& train, TrainState state);

// Returns the costs of a step on each level of the image pyramid. The costs are computed from two
// measurements: one with the splats of `initial`, and one with `most` splats, which are copies of these
// splats. If `most` is not larger than the number of initial splats, only the first measurement is made.
std::vector<StepCost> measure_steps(Device& device, const Plan& plan, const Split& train,
                                    const SplatModel& initial, std::size_t most);

// Returns the current state of `trainer` with the splats of `model` instead of its own. All moments and loss
// sums are 0.
TrainState first_state(const Trainer& trainer, SplatModel model, const TrainSettings& settings);

}  // namespace ubs
