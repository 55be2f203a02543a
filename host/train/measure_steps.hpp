// SPDX-License-Identifier: Apache-2.0
// Measures what training steps take on this device, with a model that learns nothing from it.
#pragma once

#include <vector>

#include "host/scene/dataset.hpp"
#include "host/train/time_budget.hpp"
#include "host/train/trainer.hpp"

namespace ubs {

// Returns the settings of a run that takes the steps of `settings`, but keeps its number of splats, of which
// there may be `most`, and does not end soon.
TrainSettings measuring_settings(TrainSettings settings, std::size_t most);

// Returns the milliseconds of a step from this state on, on each level of the image pyramid: the mean over
// some views. `trainer` has measuring_settings().
std::vector<double> step_times(Trainer& trainer, const Split& train, TrainState state);

// Returns the costs on each level, from steps with the splats of `initial` and with `most`, copies of them.
std::vector<StepCost> measure_steps(Device& device, const TrainSettings& settings, const Split& train,
                                    const SplatModel& initial, std::size_t most);

// Returns the state of a run that begins with these splats.
TrainState first_state(const Trainer& trainer, SplatModel model, const TrainSettings& settings);

}  // namespace ubs
