// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/mcmc.hpp"

#include "host/device/stage_checks.hpp"
#include "host/opencl/optimiser.hpp"
#include "host/scene/splat_model.hpp"
#include "kernels/layout.h"

namespace ubs::opencl {
namespace {

std::uint32_t low_word(std::uint64_t value) { return static_cast<std::uint32_t>(value); }
std::uint32_t high_word(std::uint64_t value) { return static_cast<std::uint32_t>(value >> 32); }

Range items(std::uint32_t count) { return {round_up(count, kFlatGroup)}; }

// With the prefix sum of the weights.
ProgramSpec draw_program(const KernelConfig& config) {
  ProgramSpec draws = update_program(
      {"math/rotation.h", "math/covariance.h", "math/mcmc.h", "math/rng.h", "map/mcmc.cl"}, 1, config);
  return with_scan(std::move(draws), config, "uint", "ulong");
}

}  // namespace

Mcmc::Mcmc(OpenclDevice& device, const KernelConfig& config)
    : device_(device),
      width_(config.raster == RasterKind::gpu ? 1 : device.vector_width()),
      rows_(static_cast<std::size_t>(ParameterLayout(config.dim, config.variant).count)),
      scan_(device, config, draw_program(config)),
      kernels_(device, draw_program(config)),
      noise_(device, step_program(width_, config)) {}

void Mcmc::reserve_scratch(std::uint32_t count, std::uint32_t slots) {
  ubs::reserve(device_, weights_, "mcmc weights", count);
  ubs::reserve(device_, copy_counts_, "mcmc copies", count);
  ubs::reserve(device_, source_ids_, "mcmc sources", slots);
  ubs::reserve(device_, prefix_, "mcmc prefix", count + std::size_t{1});
  ubs::reserve(device_, totals_, "mcmc totals", 1);
}

void Mcmc::replace(const SplatView& splats, BufferView<float> moment1, BufferView<float> moment2,
                   const Draw& draw) {
  reserve_scratch(splats.count, draw.slots);
  totals_.zero();
  const Range local{kFlatGroup};
  weigh({splats, draw.alive_only, weights_.view(), copy_counts_.view()});
  scan_.exclusive(weights_.view(), prefix_.view(), splats.count);
  kernels_[kMcmcDraw](items(draw.slots), local, prefix_.view(),
                      draw.alive_only ? weights_.view() : BufferView<std::uint32_t>{}, splats.count,
                      draw.slots, draw.purpose, low_word(draw.seed), high_word(draw.seed),
                      low_word(draw.iteration), high_word(draw.iteration), source_ids_.view(),
                      copy_counts_.view(), totals_.view());
  split({splats, copy_counts_.view(), moment1, moment2});
  kernels_[kMcmcCopies](items(draw.slots), local, splats.params, splats.stride, draw.first, draw.slots,
                        source_ids_.view(), moment1, moment2);
}

std::uint32_t Mcmc::relocate(const Relocate& stage) {
  check_view(stage.splats, rows_);
  const std::uint32_t count = stage.splats.count;
  if (count == 0) return 0;
  replace(stage.splats, stage.moment1, stage.moment2,
          {0, count, kDrawRelocate, true, stage.seed, stage.iteration});
  std::uint32_t moved = 0;
  totals_.download(std::span(&moved, 1));
  return moved;
}

void Mcmc::grow(const Grow& stage) {
  check_view(stage.splats, rows_);
  const SplatView& splats = stage.splats;
  if (stage.target <= splats.count) return;
  if (splats.count == 0) fail(ErrorKind::internal, "growth from no splats to {}", stage.target);
  if (stage.target > splats.stride)
    fail(ErrorKind::internal, "growth to {} splats with room for {}", stage.target, splats.stride);
  replace(splats, stage.moment1, stage.moment2,
          {splats.count, stage.target - splats.count, kDrawGrow, false, stage.seed, stage.iteration});
}

void Mcmc::weigh(const SamplingWeights& stage) {
  check_view(stage.splats, rows_);
  if (stage.splats.count == 0) return;
  kernels_[kMcmcWeights](items(stage.splats.count), Range{kFlatGroup}, stage.splats.params,
                         stage.splats.count, stage.splats.stride,
                         static_cast<std::uint32_t>(stage.alive_only), stage.weights, stage.copy_counts);
}

void Mcmc::split(const SplitSources& stage) {
  check_view(stage.splats, rows_);
  if (stage.splats.count == 0) return;
  kernels_[kMcmcSources](items(stage.splats.count), Range{kFlatGroup}, stage.splats.params,
                         stage.splats.count, stage.splats.stride, stage.copy_counts, stage.moment1,
                         stage.moment2);
}

void Mcmc::add_noise(const AddNoise& stage) {
  check_view(stage.splats, rows_);
  const SplatView& splats = stage.splats;
  if (splats.count == 0 || stage.amount == 0) return;
  noise_[kAddNoise](items((splats.count + width_ - 1) / width_), {kFlatGroup}, splats.params, splats.count,
                    splats.stride, stage.amount, low_word(stage.seed), high_word(stage.seed),
                    low_word(stage.iteration), high_word(stage.iteration), stage.first);
}

}  // namespace ubs::opencl
