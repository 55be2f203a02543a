// SPDX-License-Identifier: Apache-2.0
#include "cuda_backend/kernel_choice.hpp"

#include <cstdlib>
#include <optional>

namespace ubs::cuda {
namespace {

bool sources_replaced() {
  const char* folder = std::getenv("UBS_KERNEL_DIR");
  return folder && *folder;
}

bool compiled_ahead(const Options& switches) { return switches.empty() && !sources_replaced(); }
bool compiled_ahead(const Options& switches, int dim) {
  return dim <= kLastDimAhead && compiled_ahead(switches);
}

// Returns the configuration with the backward pass enabled. A configuration without a backward pass uses the
// same kernels that were compiled ahead of time, because these also work without masks and slots.
KernelConfig with_backward(KernelConfig config) {
  config.backward = true;
  return config;
}

Options project_switches(const KernelConfig& config) {
  Options options = variant_options(config);
  append(options, arithmetic_options(config.math));
  append(options, extent_options(config));
  append(options, frozen_options(config));
  append(options, depth_gradient_options(config));
  append(options, array_options(config));
  return options;
}

// Returns no program if the kernels were compiled ahead of time.
std::optional<ProgramSpec> project_program(const KernelConfig& config) {
  if (!config.query_grad && compiled_ahead(project_switches(with_backward(config)), config.dim))
    return std::nullopt;
  ProgramSpec spec{"cuda_backend/map_project.cuh", {"project_forward"}, project_switches(config)};
  if (config.backward) spec.kernels.push_back("project_backward");
  spec.options.push_back(fmt::format("-DUBS_N={}", config.dim));
  if (config.query_grad) spec.options.push_back("-DUBS_QUERY_GRAD=1");
  return spec;
}

ProgramSpec camera_program(KernelConfig config) {
  config.frozen = 0;  // the camera gradient does not depend on which groups are trained
  ProgramSpec spec{"cuda_backend/map_camera.cuh", {"camera_backward"}, project_switches(config)};
  append(spec.options, {fmt::format("-DUBS_N={}", config.dim), "-DUBS_CAMERA_GRAD=1"});
  return spec;
}

std::optional<ProgramSpec> parameter_program(const KernelConfig& config) {
  Options switches = variant_options(config.variant);
  append(switches, frozen_options(config));
  if (compiled_ahead(switches, config.dim)) return std::nullopt;
  switches.push_back(fmt::format("-DUBS_N={}", config.dim));
  return ProgramSpec{"cuda_backend/map_parameters.cuh",
                     {"adam_step", "adam_step_watched", "regularise", "add_noise", "mcmc_weights",
                      "mcmc_draw", "mcmc_sources", "mcmc_copies", "mcmc_places"},
                     switches};
}

std::optional<ProgramSpec> raster_program(const KernelConfig& config) {
  KernelConfig plain = with_backward(config);
  plain.depth = false;
  if (compiled_ahead(raster_options(plain))) return std::nullopt;
  ProgramSpec spec{"cuda_backend/raster_program.cuh",
                   {"raster_gpu_parts", "raster_gpu_forward", "raster_gpu_join"},
                   raster_options(config)};
  if (config.backward) spec.kernels.insert(spec.kernels.end(), {"raster_gpu_backward", "sum_slots_scalar"});
  return spec;
}

std::optional<ProgramSpec> weight_program(const KernelConfig& config) {
  KernelConfig plain = with_backward(config);
  plain.depth = false;
  if (compiled_ahead(raster_options(plain))) return std::nullopt;
  ProgramSpec spec{"cuda_backend/weights_program.cuh", {"measure_weights"}, raster_options(plain)};
  return spec;
}

}  // namespace

ProjectKernels project_kernels(CudaDevice& device, const KernelConfig& config) {
  const auto program = project_program(config);
  if (!program) return compiled_project_kernels(config.dim);
  const Module& module = device.module(*program);
  ProjectKernels kernels;
  module.bind(kernels.forward, "project_forward");
  if (config.backward) module.bind(kernels.backward, "project_backward");
  return kernels;
}

CameraKernels camera_kernels(CudaDevice& device, const KernelConfig& config) {
  CameraKernels kernels;
  device.module(camera_program(config)).bind(kernels.backward, "camera_backward");
  return kernels;
}

ParameterKernels parameter_kernels(CudaDevice& device, const KernelConfig& config) {
  const auto program = parameter_program(config);
  if (!program) return compiled_parameter_kernels(config.dim);
  const Module& module = device.module(*program);
  ParameterKernels kernels;
  module.bind<AdamKernel>(kernels, kAdam.name);
  module.bind<WatchedAdamKernel>(kernels, kWatchedAdam.name);
  module.bind<RegulariseKernel>(kernels, kRegularise.name);
  module.bind<AddNoiseKernel>(kernels, kAddNoise.name);
  module.bind<McmcWeightsKernel>(kernels, kMcmcWeights.name);
  module.bind<McmcDrawKernel>(kernels, kMcmcDraw.name);
  module.bind<McmcSourcesKernel>(kernels, kMcmcSources.name);
  module.bind<McmcCopiesKernel>(kernels, kMcmcCopies.name);
  return kernels;
}

RasterKernels raster_kernels(CudaDevice& device, const KernelConfig& config) {
  const auto program = raster_program(config);
  if (!program) return config.depth ? raster_kernels_depth() : raster_kernels_plain();
  const Module& module = device.module(*program);
  RasterKernels kernels;
  module.bind(kernels.parts, "raster_gpu_parts");
  module.bind(kernels.forward, "raster_gpu_forward");
  module.bind(kernels.join, "raster_gpu_join");
  if (!config.backward) return kernels;
  module.bind(kernels.backward, "raster_gpu_backward");
  module.bind(kernels.sum_slots, "sum_slots_scalar");
  return kernels;
}

WeightKernels weight_kernels(CudaDevice& device, const KernelConfig& config) {
  const auto program = weight_program(config);
  if (!program) return weight_kernels_plain();
  WeightKernels kernels;
  device.module(*program).bind(kernels.measure, "measure_weights");
  return kernels;
}

std::vector<ProgramSpec> run_time_programs(const KernelConfig& config) {
  std::vector<ProgramSpec> programs;
  if (config.backward) programs.push_back(camera_program(config));
  for (const auto& program :
       {project_program(config), parameter_program(config), raster_program(config), weight_program(config)})
    if (program) programs.push_back(*program);
  return programs;
}

}  // namespace ubs::cuda
