// SPDX-License-Identifier: Apache-2.0
#include "cuda_backend/parameters.hpp"

#include "cuda_backend/grid.hpp"
#include "cuda_backend/kernel_choice.hpp"
#include "host/device/stage_checks.hpp"
#include "host/scene/frozen_groups.hpp"
#include "kernels/layout.h"

namespace ubs::cuda {
namespace {

u32 low_word(std::uint64_t value) { return static_cast<u32>(value); }
u32 high_word(std::uint64_t value) { return static_cast<u32>(value >> 32); }

}  // namespace

Parameters::Parameters(CudaDevice& device, const KernelConfig& config)
    : device_(device),
      config_(config),
      rows_(static_cast<std::size_t>(ParameterLayout(config.dim, config.variant).count)),
      trained_rows_(
          static_cast<std::size_t>(trained_rows(ParameterLayout(config.dim, config.variant), config.frozen))),
      project_(project_kernels(device, config)),
      block_(tuned_value(tuned_constants(), device.info().tuning, kTunedMapBlock)) {}

dim3 Parameters::items(u32 count, std::size_t rows) const {
  return {blocks(count, block_), static_cast<unsigned>(rows), 1};
}

const ParameterKernels& Parameters::kernels() {
  if (!kernels_) kernels_ = parameter_kernels(device_, config_);
  return *kernels_;
}

void Parameters::project_forward(const ProjectForward& a) {
  check_view(a.splats, rows_);
  device_.launch("project_forward", project_.forward, items(a.splats.count), block_, a.splats.params,
                 a.splats.count, a.splats.stride, a.first_record, a.cameras, a.camera, a.settings.near_plane,
                 a.settings.far_plane, a.settings.eps2d, a.records, a.depth_keys, a.tile_rects,
                 a.tile_counts);
}

void Parameters::project_backward(const ProjectBackward& a) {
  check_backward(config_, "projection backward");
  check_view(a.splats, rows_);
  device_.launch("project_backward", project_.backward, items(a.splats.count), block_, a.splats.params,
                 a.splats.count, a.splats.stride, a.first_record, a.cameras, a.camera, a.settings.near_plane,
                 a.settings.far_plane, a.settings.eps2d, a.v_records, a.v_params,
                 static_cast<u32>(a.accumulate));
}

void Parameters::camera_backward(const CameraBackward& work) {
  check_camera_backward(config_, work);
  const ProjectBackward& a = work.gradient;
  check_view(a.splats, rows_);
  if (!camera_.backward.symbol && !camera_.backward.function) camera_ = camera_kernels(device_, config_);
  device_.launch("camera_backward", camera_.backward, items(work.lanes), block_, a.splats.params,
                 a.splats.count, a.splats.stride, a.first_record, a.cameras, a.camera, a.settings.near_plane,
                 a.settings.far_plane, a.settings.eps2d, a.v_records, work.v_camera, work.lanes);
}

void Parameters::regularise(const Regularise& a) {
  check_view(a.splats, rows_);
  if (a.splats.count == 0 || (a.opacity == 0 && a.scale == 0)) return;
  const PenaltyWeights weights = penalty_weights(a);
  const std::size_t rows = a.scale != 0 ? 4 : 1;
  device_.launch("regularise", kernels().regularise, items(a.splats.count, rows), block_, a.splats.params,
                 a.v_params, a.splats.count, a.splats.stride, weights.opacity, weights.scale);
}

void Parameters::adam(const AdamStep& a) {
  check_adam(a, rows_, trained_rows_);
  const BiasCorrection bias = bias_correction(a);
  const auto launch = [&](const char* name, auto kernel, const auto&... watch) {
    device_.launch(name, kernel, items(a.splats.count, trained_rows_), block_, a.splats.params, a.v_params,
                   a.moment1, a.moment2, a.learning_rates, a.splats.count, a.splats.stride, a.beta1, a.beta2,
                   a.epsilon, bias.inverse1, bias.inverse_sqrt2, watch...);
  };
  if (a.sentinel.size > 0)
    launch("adam_step_watched", kernels().adam_watched, a.sentinel, a.stamp);
  else
    launch("adam_step", kernels().adam);
}

void Parameters::replace(const SplatView& splats, BufferView<float> moment1, BufferView<float> moment2,
                         const Draw& draw) {
  reserve(device_, weights_, "mcmc weights", splats.count);
  reserve(device_, copy_counts_, "mcmc copies", splats.count);
  reserve(device_, source_ids_, "mcmc sources", draw.slots);
  reserve(device_, prefix_, "mcmc prefix", splats.count + std::size_t{1});
  reserve(device_, totals_, "mcmc totals", 1);
  totals_.zero();
  weigh({splats, draw.alive_only, weights_.view(), copy_counts_.view()});
  // prefix[0] = 0, prefix[i + 1] = sum through i, prefix[count] = total.
  u64* const prefix = pointer_of(prefix_.view());
  device_.fill_zero(*prefix_.view().memory, 0, sizeof(u64));
  device_.algorithm("mcmc_prefix", [&](Workspace& workspace) {
    return scan_inclusive(workspace, pointer_of(weights_.view()), prefix + 1, splats.count, device_.stream());
  });
  device_.launch("mcmc_draw", kernels().mcmc_draw, items(draw.slots), block_, prefix_.view(),
                 draw.alive_only ? weights_.view() : BufferView<u32>{}, splats.count, draw.slots,
                 draw.purpose, low_word(draw.seed), high_word(draw.seed), low_word(draw.iteration),
                 high_word(draw.iteration), source_ids_.view(), copy_counts_.view(), totals_.view());
  split({splats, copy_counts_.view(), moment1, moment2});
  device_.launch("mcmc_copies", kernels().mcmc_copies, items(draw.slots), block_, splats.params,
                 splats.stride, draw.first, draw.slots, source_ids_.view(), moment1, moment2);
}

std::uint32_t Parameters::relocate(const Relocate& a) {
  check_view(a.splats, rows_);
  const u32 count = a.splats.count;
  if (count == 0) return 0;
  replace(a.splats, a.moment1, a.moment2, {0, count, kDrawRelocate, true, a.seed, a.iteration});
  u32 moved = 0;
  totals_.download(std::span(&moved, 1));
  return moved;
}

void Parameters::grow(const Grow& a) {
  check_view(a.splats, rows_);
  const u32 count = a.splats.count;
  if (a.target <= count) return;
  if (count == 0) fail(ErrorKind::internal, "growth from no splats to {}", a.target);
  if (a.target > a.splats.stride)
    fail(ErrorKind::internal, "growth to {} splats with room for {}", a.target, a.splats.stride);
  replace(a.splats, a.moment1, a.moment2, {count, a.target - count, kDrawGrow, false, a.seed, a.iteration});
}

void Parameters::weigh(const SamplingWeights& a) {
  check_view(a.splats, rows_);
  if (a.splats.count == 0) return;
  device_.launch("mcmc_weights", kernels().mcmc_weights, items(a.splats.count), block_, a.splats.params,
                 a.splats.count, a.splats.stride, static_cast<u32>(a.alive_only), a.weights, a.copy_counts);
}

void Parameters::split(const SplitSources& a) {
  check_view(a.splats, rows_);
  if (a.splats.count == 0) return;
  device_.launch("mcmc_sources", kernels().mcmc_sources, items(a.splats.count), block_, a.splats.params,
                 a.splats.count, a.splats.stride, a.copy_counts, a.moment1, a.moment2);
}

void Parameters::add_noise(const AddNoise& a) {
  check_view(a.splats, rows_);
  if (a.splats.count == 0 || a.amount == 0) return;
  device_.launch("add_noise", kernels().add_noise, items(a.splats.count), block_, a.splats.params,
                 a.splats.count, a.splats.stride, a.amount, low_word(a.seed), high_word(a.seed),
                 low_word(a.iteration), high_word(a.iteration), a.first);
}

}  // namespace ubs::cuda
