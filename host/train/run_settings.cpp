// SPDX-License-Identifier: Apache-2.0
#include "host/train/run_settings.hpp"

#include "host/device/registry.hpp"

namespace ubs {

KernelConfig kernel_config(int dim, const ModelVariant& variant, const TrainSettings& settings,
                           const DeviceInfo& device) {
  KernelConfig config;
  config.dim = dim;
  config.raster = raster_kind(settings.raster, device);
  config.query_grad = settings.query_grad;
  config.variant = variant;
  config.work = work_switches(settings);
  config.noise_gate = settings.noise_gate == "sigmoid" ? NoiseGate::sigmoid : NoiseGate::pow100;
  config.approximation = approximation(settings);
  config.atomics = settings.atomics;
  return config;
}

RenderSettings render_settings(const TrainSettings& settings) {
  RenderSettings render;
  render.projection = {static_cast<float>(settings.near_plane), static_cast<float>(settings.far_plane),
                       static_cast<float>(settings.eps2d)};
  for (std::size_t c = 0; c < 3; ++c) render.background[c] = static_cast<float>(settings.background[c]);
  return render;
}

// On CPUs the wait is one launch in a step of thousands, and the host's thread that runs ahead takes a core
// (docs/performance-notes-lists.md); on GPUs it drains the queue.
bool lists_uncounted(const TrainSettings& settings, const DeviceInfo& device) {
  return settings.list_counts == "bound" || (settings.list_counts == "auto" && device.type != DeviceType::cpu);
}

}  // namespace ubs
