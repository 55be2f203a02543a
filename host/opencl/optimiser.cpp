// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/optimiser.hpp"

#include <cmath>

#include "host/device/stage_checks.hpp"
#include "host/scene/frozen_groups.hpp"

namespace ubs::opencl {
namespace {

// Flat kernels lose half of the bandwidth on PoCL with 16 work-items a group.
constexpr std::size_t kGroup = 64;

ProgramSpec program(unsigned width, const KernelConfig& config, const char* kernel) {
  ProgramSpec spec{{"math/adam.h", kernel}, variant_options(config.variant)};
  append(spec.options, frozen_options(config));
  spec.options.push_back("-DUBS_VW=" + std::to_string(width));
  spec.options.push_back("-DUBS_N=" + std::to_string(config.dim));
  return spec;
}

void check_view(const SplatView& splats, std::size_t rows) {
  if (splats.count > splats.stride || splats.stride % 64 != 0 || splats.params.size < rows * splats.stride)
    fail(ErrorKind::internal, "{} splats with stride {} in {} rows of a buffer of {}", splats.count,
         splats.stride, rows, splats.params.size);
}

}  // namespace

Optimiser::Optimiser(OpenclDevice& device, const KernelConfig& config)
    : width_(config.raster == RasterKind::gpu ? 1 : vector_width(device, config)),
      rows_(static_cast<std::size_t>(ParameterLayout(config.dim, config.variant).count)),
      trained_rows_(
          static_cast<std::size_t>(trained_rows(ParameterLayout(config.dim, config.variant), config.frozen))),
      adam_(device, program(width_, config, "map/adam.cl")),
      regularise_(device, program(width_, config, "map/regularise.cl")) {}

Range Optimiser::items(std::uint32_t count, std::size_t rows) const {
  return {round_up((count + width_ - 1) / width_, kGroup), rows, 1};
}

void Optimiser::regularise(const Regularise& stage) {
  const SplatView& splats = stage.splats;
  check_view(splats, rows_);
  if (splats.count == 0 || (stage.opacity == 0 && stage.scale == 0)) return;
  const float count = static_cast<float>(splats.count);
  const std::size_t rows = stage.scale != 0 ? 4 : 1;
  regularise_["regularise"](items(splats.count, rows), {kGroup}, splats.params, stage.v_params, splats.count,
                            splats.stride, stage.opacity / count, stage.scale / (3 * count));
}

void Optimiser::adam(const AdamStep& stage) {
  const SplatView& splats = stage.splats;
  check_view(splats, rows_);
  if (stage.learning_rates.size < rows_)
    fail(ErrorKind::internal, "Adam: {} learning rates for {} parameter rows", stage.learning_rates.size,
         rows_);
  const std::size_t learnt = trained_rows_ * splats.stride;
  if (stage.v_params.size < learnt || stage.moment1.size < learnt || stage.moment2.size < learnt)
    fail(ErrorKind::internal, "Adam: gradients and moments of {}, {} and {} values for {} rows of {}",
         stage.v_params.size, stage.moment1.size, stage.moment2.size, trained_rows_, splats.stride);
  if (stage.step == 0) fail(ErrorKind::internal, "Adam: steps are counted from 1");
  if (splats.count == 0) return;
  const double step = static_cast<double>(stage.step);
  const double bias1 = 1 - std::pow(static_cast<double>(stage.beta1), step);
  const double bias2 = 1 - std::pow(static_cast<double>(stage.beta2), step);
  const auto launch = [&](const char* kernel, const auto&... watch) {
    adam_[kernel](items(splats.count, trained_rows_), {kGroup}, splats.params, stage.v_params, stage.moment1,
                  stage.moment2, stage.learning_rates, splats.count, splats.stride, stage.beta1, stage.beta2,
                  stage.epsilon, static_cast<float>(1 / bias1), static_cast<float>(1 / std::sqrt(bias2)),
                  watch...);
  };
  check_watch(stage);
  if (stage.sentinel.size > 0)
    launch("adam_step_watched", stage.sentinel, stage.stamp);
  else
    launch("adam_step");
}

}  // namespace ubs::opencl
