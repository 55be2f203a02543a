// SPDX-License-Identifier: Apache-2.0
// Times of drawing a view and of a training step (forward, loss, backward, Adam) of two models, taken in turn
// so that both meet the same machine.
#pragma once

#include <array>

#include "host/base/statistics.hpp"
#include "host/pipeline/device_groups.hpp"
#include "host/train/target_images.hpp"

namespace ubs::reduce {

struct ModelTimes {
  Summary render_ms, step_ms;  // wall time to an idle device
};

struct TimedModel {
  const DeviceGroups* model;
  Renderer* renderer;  // with the cameras of the views
};

// `rounds` views, evenly spread over the first `views` of the renderers, whose images `targets` has under the
// same numbers; one round before them is not counted.
std::array<ModelTimes, 2> measure_times(Device& device, const std::array<TimedModel, 2>& models,
                                        const RenderSettings& settings, std::size_t views,
                                        TargetImages& targets, std::size_t rounds);

}  // namespace ubs::reduce
