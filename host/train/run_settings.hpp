// SPDX-License-Identifier: Apache-2.0
// The functions of this file convert the settings of a run into the inputs of the pipeline: kernel
// configuration, render settings, initialisation options, and the input of the memory estimate.
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

// Returns the kernel configuration for a model with this dim and variant, which may differ from those of the
// settings.
KernelConfig kernel_config(int dim, const ModelVariant& variant, const TrainSettings& settings,
                           const DeviceInfo& device);
// Returns the kernel configuration of a training, in which the frozen parameter groups are not trained.
KernelConfig training_config(const TrainSettings& settings, const DeviceInfo& device);
RenderSettings render_settings(const TrainSettings& settings);
// Returns the background `behind` with the values that have been learnt so far. `sky` is that of a
// TrainState; it is empty if the background is not learnt.
Background learnt_background(Background behind, const std::vector<float>& sky);
// Returns the options for initialising splats.
InitOptions init_options(const TrainSettings& settings);
// Throws Error(usage) if a training with these settings cannot start from the model, because its dimension or
// variant differs.
void check_initial(const TrainSettings& settings, const SplatModel& initial);
// Returns whether training renders without waiting for the size of the lists. The setting list_counts
// determines this. If it is auto, the device type decides.
bool lists_uncounted(const TrainSettings& settings, const DeviceInfo& device);

// Returns "key=value" for the settings that specialise kernels and are not at their defaults: skipped work,
// approximations, frozen groups. N, `raster` and the variant of the model are not included.
std::vector<std::string> kernel_assignments(const TrainSettings& settings);

// Replaces "auto" in the fields that depend on other settings: noise_lr (1e6, with time 1; an automatic unit
// sets it already), lr_rgb (1e-3, with spherical harmonics or lobes 2.5e-3), lr_opacity (0.05, with kernel
// gaussian 0.025) and lr_scale (0.005, with kernel gaussian 0.02). dim must be a number.
TrainSettings resolve_automatic(TrainSettings settings);

// Returns the input of plan_memory() for a training with at most `splats` splats on views of these sizes. The
// number of intersections remains 0.
MemoryQuestion memory_question(const TrainSettings& settings, const Split& train, const Split& test,
                               const DeviceInfo& device, std::size_t splats);

}  // namespace ubs
