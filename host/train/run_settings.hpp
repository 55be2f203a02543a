// SPDX-License-Identifier: Apache-2.0
// From the settings of a run to what the pipeline takes.
#pragma once

#include "host/device/stages.hpp"
#include "host/pipeline/renderer.hpp"
#include "host/spec/train_settings.hpp"

namespace ubs {

// dim and variant: of the model at hand, which need not be those of the settings.
KernelConfig kernel_config(int dim, const ModelVariant& variant, const TrainSettings& settings,
                           const DeviceInfo& device);
RenderSettings render_settings(const TrainSettings& settings);
// Whether training does not wait for the size of the lists: list_counts, where auto is decided by the device.
bool lists_uncounted(const TrainSettings& settings, const DeviceInfo& device);

}  // namespace ubs
