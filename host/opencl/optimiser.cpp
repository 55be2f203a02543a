// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/optimiser.hpp"

#include "host/device/stage_checks.hpp"
#include "host/scene/frozen_groups.hpp"

namespace ubs::opencl {

ProgramSpec update_program(std::vector<std::string> sources, unsigned width, const KernelConfig& config) {
  ProgramSpec spec{std::move(sources), variant_options(config.variant)};
  append(spec.options, frozen_options(config));
  append(spec.options, {fmt::format("-DUBS_VW={}", width), fmt::format("-DUBS_N={}", config.dim)});
  return spec;
}

ProgramSpec step_program(unsigned width, const KernelConfig& config) {
  return update_program({"math/adam.h", "map/adam_row.h", "map/adam.cl", "map/regularise.cl",
                         "math/rotation.h", "math/covariance.h", "math/mcmc.h", "math/rng.h", "map/noise.cl"},
                        width, config);
}

Optimiser::Optimiser(OpenclDevice& device, const KernelConfig& config)
    : width_(config.raster == RasterKind::gpu ? 1 : device.vector_width()),
      rows_(static_cast<std::size_t>(ParameterLayout(config.dim, config.variant).count)),
      trained_rows_(
          static_cast<std::size_t>(trained_rows(ParameterLayout(config.dim, config.variant), config.frozen))),
      kernels_(device, step_program(width_, config)) {}

Range Optimiser::items(std::uint32_t count, std::size_t rows) const {
  return {round_up((count + width_ - 1) / width_, kFlatGroup), rows, 1};
}

void Optimiser::regularise(const Regularise& stage) {
  const SplatView& splats = stage.splats;
  check_view(splats, rows_);
  if (splats.count == 0 || (stage.opacity == 0 && stage.scale == 0)) return;
  const PenaltyWeights weights = penalty_weights(stage);
  const std::size_t rows = stage.scale != 0 ? 4 : 1;
  kernels_[kRegularise](items(splats.count, rows), {kFlatGroup}, splats.params, stage.v_params, splats.count,
                        splats.stride, weights.opacity, weights.scale);
}

void Optimiser::adam(const AdamStep& stage) {
  const SplatView& splats = stage.splats;
  check_adam(stage, rows_, trained_rows_);
  if (splats.count == 0) return;
  const BiasCorrection bias = bias_correction(stage);
  const auto launch = [&](const auto& kernel, const auto&... watch) {
    kernels_[kernel](items(splats.count, trained_rows_), {kFlatGroup}, splats.params, stage.v_params,
                     stage.moment1, stage.moment2, stage.learning_rates, splats.count, splats.stride,
                     stage.beta1, stage.beta2, stage.epsilon, bias.inverse1, bias.inverse_sqrt2, watch...);
  };
  if (stage.sentinel.size > 0)
    launch(kWatchedAdam, stage.sentinel, stage.stamp);
  else
    launch(kAdam);
}

}  // namespace ubs::opencl
