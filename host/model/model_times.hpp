// SPDX-License-Identifier: Apache-2.0
// measure_times() measures the time of rendering a view and of a training step (forward, loss, backward,
// Adam) for two models. The models are measured alternately, so that both run under the same conditions.
#pragma once

#include <array>

#include "host/base/statistics.hpp"
#include "host/pipeline/device_groups.hpp"
#include "host/train/target_images.hpp"

namespace ubs::reduce {

struct ModelTimes {
  Summary render_ms, step_ms;  // wall times until the device is idle [ms]
};

struct TimedModel {
  const DeviceGroups* model;
  Renderer* renderer;  // must have the cameras of the views
};

// Measures both models in `rounds` rounds, each with one view. The views are evenly spread over the first
// `views` cameras of the renderers, and `targets` contains the image of each view under the same index. A
// warm-up round precedes the others and is not counted.
std::array<ModelTimes, 2> measure_times(Device& device, const std::array<TimedModel, 2>& models,
                                        const RenderSettings& settings, std::size_t views,
                                        TargetImages& targets, std::size_t rounds);

}  // namespace ubs::reduce
