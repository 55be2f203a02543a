// SPDX-License-Identifier: Apache-2.0
// From the settings of a run to what the pipeline takes.
#pragma once

#include <string>
#include <vector>

#include "host/device/stages.hpp"
#include "host/pipeline/memory_plan.hpp"
#include "host/pipeline/renderer.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/initialise.hpp"
#include "host/scene/train_settings.hpp"

namespace ubs {

// dim and variant: of the model at hand, which need not be those of the settings.
KernelConfig kernel_config(int dim, const ModelVariant& variant, const TrainSettings& settings,
                           const DeviceInfo& device);
// What a training needs of a device: without the groups that are not learnt.
KernelConfig training_config(const TrainSettings& settings, const DeviceInfo& device);
RenderSettings render_settings(const TrainSettings& settings);
// `behind` as it has been learnt so far. `sky`: of a TrainState, empty where it is not learnt.
Background learnt_background(Background behind, const std::vector<float>& sky);
// How the splats of the settings start.
InitOptions init_options(const TrainSettings& settings);
// Throws Error(usage) where a training with these settings cannot begin with the model: another dimension or
// form.
void check_initial(const TrainSettings& settings, const SplatModel& initial);
// Whether training does not wait for the size of the lists: list_counts, where auto is decided by the device.
bool lists_uncounted(const TrainSettings& settings, const DeviceInfo& device);

// "key=value" of the settings that kernels are specialised by beside N, `raster` and the form of the model,
// where they are not at their defaults: work that is left out, approximations, groups that are not learnt.
std::vector<std::string> kernel_assignments(const TrainSettings& settings);

// Real fields at "auto" that depend on other settings: noise_lr (1e6, with time 1), lr_opacity (0.05, kernel
// gaussian 0.025) and lr_scale (0.005, kernel gaussian 0.02). dim must be a number.
TrainSettings resolve_automatic(TrainSettings settings);

// Returns the question about the device memory of a training with `splats` splats at most, for the image
// sizes of these views. The number of intersections is left at 0.
MemoryQuestion memory_question(const TrainSettings& settings, const Split& train, const Split& test,
                               const DeviceInfo& device, std::size_t splats);

}  // namespace ubs
