// SPDX-License-Identifier: Apache-2.0
// From the settings of a run to what the pipeline takes.
#pragma once

#include "host/device/stages.hpp"
#include "host/pipeline/renderer.hpp"
#include "host/spec/train_settings.hpp"

namespace ubs {

// dim: of the model at hand, which need not be that of the settings.
KernelConfig kernel_config(int dim, const TrainSettings& settings, const DeviceInfo& device);
RenderSettings render_settings(const TrainSettings& settings);

}  // namespace ubs
