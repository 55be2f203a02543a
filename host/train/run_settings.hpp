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
#include "host/settings/train_settings.hpp"

namespace ubs {

// Returns the kernel configuration for a model with this dim and variant, which may differ from those of the
// settings.
KernelConfig kernel_config(int dim, const ModelVariant& variant, const TrainSettings& settings,
                           const DeviceInfo& device);
// Returns the kernel configuration for training, in which the frozen parameter groups are not trained.
KernelConfig training_config(const TrainSettings& settings, const DeviceInfo& device);
// Returns the settings of the renderer: the near and the far plane, the blur and the background.
RenderSettings render_settings(const TrainSettings& settings);
// Returns `behind` with the colour, or the sky, that training has learnt so far. `sky` is TrainState::sky. If
// it is empty, the background is not learnt, and `behind` is returned unchanged.
Background learnt_background(Background behind, const std::vector<float>& sky);
// Returns the options for initialising splats.
InitOptions init_options(const TrainSettings& settings);
// Throws Error(usage) if training with these settings cannot start from the model, because its dimension or
// variant differs.
void check_initial(const TrainSettings& settings, const SplatModel& initial);
// Returns whether training renders without waiting for the size of the tile lists. The setting list_counts
// determines this: with `wait` training waits, with `bound` it does not, and with `automatic` it waits only
// on CPUs.
bool lists_uncounted(const TrainSettings& settings, const DeviceInfo& device);

// Returns "key=value" for each setting with kOfKernels that is not at its default. Such settings are compiled
// into kernels: alpha_min, query_grad, math and freeze. N, `raster` and the variant of the model are not
// included.
std::vector<std::string> kernel_assignments(const TrainSettings& settings);

// Returns the input of plan_memory() for training with at most `splats` splats on these views. The number of
// intersections is set to 0.
MemoryQuestion memory_question(const TrainSettings& settings, const Split& train, const Split& test,
                               const DeviceInfo& device, std::size_t splats);

}  // namespace ubs
