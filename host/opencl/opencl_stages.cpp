// SPDX-License-Identifier: Apache-2.0
// This file implements the interface Stages on an OpenCL device. It passes each operation to the class that
// launches the kernels of this operation.
#include "host/device/backend.hpp"
#include "host/opencl/image_loss.hpp"
#include "host/opencl/lists.hpp"
#include "host/opencl/projection.hpp"
#include "host/opencl/raster.hpp"
#include "host/opencl/scan.hpp"

namespace ubs::opencl {
namespace {

using Appearance = AppearanceStages<MapKernels>;
using Sky = SkyStages<MapKernels>;
using ImageGradients = ImageGradientStages<MapKernels>;
using Drawn = DrawnStages<MapKernels, Scan>;
using ParameterChanges = ParameterStages<MapKernels, Scan>;

unsigned lanes(const OpenclDevice& device, const KernelConfig& config) {
  return config.raster == RasterKind::gpu ? 1 : device.vector_width();
}

// UBS_COLOUR=3 selects spherical harmonics up to degree 2.
ProgramSpec sky_program(unsigned width) {
  return {{"math/rotation.h", "math/colour.h", "map/row_sums.cl", "map/sky.h", "map/sky.cl"},
          {"-DUBS_VW=" + std::to_string(width), "-DUBS_COLOUR=3"}};
}

ProgramSpec parameter_program(std::vector<std::string> sources, unsigned width, const KernelConfig& config) {
  ProgramSpec spec{std::move(sources), variant_options(config.variant)};
  append(spec.options, frozen_options(config));
  append(spec.options, {fmt::format("-DUBS_VW={}", width), fmt::format("-DUBS_N={}", config.dim)});
  return spec;
}

// Returns the program for Adam, penalties and noise.
ProgramSpec step_program(const OpenclDevice& device, const KernelConfig& config) {
  ProgramSpec spec =
      parameter_program({"math/adam.h", "map/adam_row.h", "map/adam.cl", "map/regularise.cl",
                         "math/rotation.h", "math/covariance.h", "math/mcmc.h", "math/rng.h", "map/noise.cl"},
                        lanes(device, config), config);
  append(spec.options, exact_division_options(device));
  return spec;
}

// Returns a program for the Adam step of parameters that do not belong to splats.
ProgramSpec small_step_program(const OpenclDevice& device, std::vector<std::string> sources) {
  ProgramSpec spec{std::move(sources), {"-DUBS_VW=1"}};
  append(spec.options, exact_division_options(device));
  return spec;
}

// Returns the program for relocation and growth, including the prefix sum of the weights.
ProgramSpec draw_program(const KernelConfig& config) {
  ProgramSpec draws = parameter_program(
      {"math/rotation.h", "math/covariance.h", "math/mcmc.h", "math/rng.h", "map/mcmc.cl"}, 1, config);
  return with_scan(std::move(draws), config, "uint", "ulong");
}

// Each base class has run() for some of the operations, and launches their kernels.
struct Kernels : Projection,
                 Lists,
                 Raster,
                 ImageLossKernels,
                 Appearance,
                 Sky,
                 ParameterChanges,
                 ImageGradients,
                 Drawn {
  Kernels(OpenclDevice& device, const KernelConfig& config)
      : Projection(device, config),
        Lists(device, config),
        Raster(device, config),
        ImageLossKernels(device, config),
        Appearance(
            device,
            {device, lanes(device, config), {"math/appearance.h", "map/row_sums.cl", "map/appearance.cl"}},
            {device, 1,
             small_step_program(device, {"math/adam.h", "math/appearance.h", "map/appearance_step.cl"})}),
        Sky(device, {device, lanes(device, config), sky_program(lanes(device, config))},
            {device, 1, small_step_program(device, {"math/adam.h", "map/sky.h", "map/sky_step.cl"})}),
        ParameterChanges(device, config, {device, lanes(device, config), step_program(device, config)},
                         {device, 1, draw_program(config)}, {device, config, draw_program(config)}),
        ImageGradients(device, {device, 1, {"map/row_sums.cl", "map/image_gradient.cl"}}),
        Drawn(device, {device, 1, {"map/tile_rect.h", "map/drawn.cl"}}, {device, config}) {}

  using Projection::run, Lists::run, Raster::run, Appearance::run, Sky::run, ParameterChanges::run,
      ImageGradients::run, Drawn::run;
  void run(const ImageLoss& a) {
    with_colours(a, [&](const ImageLoss& mapped) { ImageLossKernels::run(mapped); });
  }
  void run(const Learn& a) {
    if (learns_in_one_pass()) return Projection::run(a);
    run(a.gradient);
    run(a.penalty);
    run(a.step);
  }
};

template <typename... T>
bool is_any_of(const Operation& operation) {
  return (std::holds_alternative<T>(operation) || ...);
}

// OpenclStages flushes the queue after stages that are followed by other work of the host. Some drivers start
// enqueued work only when there is much work, or when the queue is flushed.
class OpenclStages final : public Stages {
 public:
  OpenclStages(OpenclDevice& device, const KernelConfig& config)
      : device_(device), config_(config), kernels_(device, config) {}

  const KernelConfig& config() const override { return config_; }
  Outcome run(const Operation& operation) override {
    const Outcome outcome = run_case(operation, [&](const auto& a) { return kernels_.run(a); });
    if (is_any_of<BuildLists, RasterForward, RasterBackward, AdamStep, Learn>(operation)) device_.flush();
    return outcome;
  }

 private:
  OpenclDevice& device_;
  KernelConfig config_;
  Kernels kernels_;
};

}  // namespace

std::unique_ptr<Stages> OpenclDevice::make_stages(const KernelConfig& config) {
  return std::make_unique<OpenclStages>(*this, config);
}

}  // namespace ubs::opencl
