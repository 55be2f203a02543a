// SPDX-License-Identifier: Apache-2.0
// ParameterStages runs the stages that train the parameters: Regularise, AdamStep, Relocate, Grow, AddNoise,
// SamplingWeights, SplitSources and PlaceCopies. Only Relocate waits for the device, because it returns the
// number of splats that it has moved. All other decisions are made on the device.
#pragma once

#include <utility>

#include "host/device/map_kernels.hpp"
#include "host/device/operation_checks.hpp"
#include "host/scene/frozen_groups.hpp"
#include "host/scene/splat_model.hpp"
#include "kernels/layout.h"

namespace ubs {

// map_stages.hpp explains the template parameters. `step` contains the kernels of adam.cl, regularise.cl and
// noise.cl. `draws` contains the kernels of mcmc.cl, compiled with one lane.
template <typename Kernels, typename Sums>
class ParameterStages {
 public:
  ParameterStages(Device& device, const KernelConfig& config, Kernels step, Kernels draws, Sums sums)
      : device_(device),
        rows_(static_cast<std::size_t>(ParameterLayout(config.dim, config.variant).count)),
        trained_rows_(static_cast<std::size_t>(
            trained_rows(ParameterLayout(config.dim, config.variant), config.frozen))),
        step_(std::move(step)),
        draws_(std::move(draws)),
        sums_(std::move(sums)) {}

  void run(const Regularise& a) {
    check_view(a.splats, rows_);
    if (a.splats.count == 0 || !any(a.weights)) return;
    step_.launch(kRegularise, a.splats.count, 1, a.splats.params, a.v_params, a.splats.count, a.splats.stride,
                 weights_per_splat(a));
  }
  void run(const AdamStep& a) {
    check_adam(a, rows_, trained_rows_);
    const BiasCorrection bias = bias_correction(a);
    const auto launch = [&](auto kernel, const auto&... watch) {
      step_.launch(kernel, a.splats.count, trained_rows_, a.splats.params, a.v_params, a.moment1, a.moment2,
                   a.learning_rates, a.splats.count, a.splats.stride, a.beta1, a.beta2, a.epsilon,
                   bias.inverse1, bias.inverse_sqrt2, watch...);
    };
    if (a.sentinel.size > 0)
      launch(kWatchedAdam, a.sentinel, a.stamp);
    else
      launch(kAdam);
  }
  std::uint32_t run(const Relocate& a) {
    check_view(a.splats, rows_);
    const u32 count = a.splats.count;
    if (count == 0) return 0;
    replace(a.splats, a.moment1, a.moment2, {0, count, kDrawRelocate, true, a.spread, a.seed, a.iteration});
    u32 moved = 0;
    totals_.download(std::span(&moved, 1));
    return moved;
  }
  void run(const Grow& a) {
    check_view(a.splats, rows_);
    const u32 count = a.splats.count;
    if (a.target <= count) return;
    if (count == 0) fail(ErrorKind::internal, "cannot grow from 0 splats to {}", a.target);
    if (a.target > a.splats.stride)
      fail(ErrorKind::internal, "cannot grow to {} splats with a capacity of {}", a.target, a.splats.stride);
    replace(a.splats, a.moment1, a.moment2,
            {count, a.target - count, kDrawGrow, false, a.spread, a.seed, a.iteration});
  }
  void run(const SamplingWeights& a) {
    check_view(a.splats, rows_);
    draws_.launch_each(kMcmcWeights, a.splats.count, 1, a.splats.params, a.splats.count, a.splats.stride,
                       static_cast<u32>(a.alive_only), a.weights, a.copy_counts);
  }
  void run(const SplitSources& a) {
    check_view(a.splats, rows_);
    draws_.launch_each(kMcmcSources, a.splats.count, 1, a.splats.params, a.splats.count, a.splats.stride,
                       a.copy_counts, a.spread, a.moment1, a.moment2);
  }
  void run(const PlaceCopies& a) {
    check_view(a.splats, rows_);
    if (a.spread == 0 || a.slots == 0) return;
    const u32 purpose = a.purpose == kDrawRelocate ? kDrawRelocatedPlace : kDrawGrownPlace;
    draws_.launch_each(kMcmcPlaces, a.slots, 1, a.splats.params, a.splats.stride, a.first, a.slots, a.sources,
                       a.spread, purpose, low_word(a.seed), high_word(a.seed), low_word(a.iteration),
                       high_word(a.iteration), a.first_number);
  }
  void run(const AddNoise& a) {
    check_view(a.splats, rows_);
    if (a.amount == 0) return;
    step_.launch(kAddNoise, a.splats.count, 1, a.splats.params, a.splats.count, a.splats.stride, a.amount,
                 low_word(a.seed), high_word(a.seed), low_word(a.iteration), high_word(a.iteration), a.first);
  }

 private:
  // Draw describes which splats may be replaced by copies of other splats: those with the indices from
  // `first` to `first` + `slots` - 1. The random numbers for the splat `first` + i depend on i.
  struct Draw {
    u32 first, slots, purpose;
    bool alive_only;
    float spread;
    std::uint64_t seed, iteration;
  };
  static u32 low_word(std::uint64_t value) { return static_cast<u32>(value); }
  static u32 high_word(std::uint64_t value) { return static_cast<u32>(value >> 32); }

  // Chooses random splats, copies them to the splats of `draw`, and adjusts their opacities, moments, sizes
  // and places.
  void replace(const SplatView& splats, BufferView<float> moment1, BufferView<float> moment2,
               const Draw& draw) {
    reserve(device_, weights_, "mcmc weights", splats.count);
    reserve(device_, copy_counts_, "mcmc copies", splats.count);
    reserve(device_, source_ids_, "mcmc sources", draw.slots);
    reserve(device_, prefix_, "mcmc prefix", splats.count + std::size_t{1});
    reserve(device_, totals_, "mcmc totals", 1);
    totals_.zero();
    run(SamplingWeights{splats, draw.alive_only, weights_.view(), copy_counts_.view()});
    sums_.exclusive(weights_.view(), prefix_.view(), splats.count);
    draws_.launch_each(kMcmcDraw, draw.slots, 1, prefix_.view(),
                       draw.alive_only ? weights_.view() : BufferView<u32>{}, splats.count, draw.slots,
                       draw.purpose, low_word(draw.seed), high_word(draw.seed), low_word(draw.iteration),
                       high_word(draw.iteration), source_ids_.view(), copy_counts_.view(), totals_.view());
    run(SplitSources{splats, copy_counts_.view(), moment1, moment2, draw.spread});
    draws_.launch_each(kMcmcCopies, draw.slots, 1, splats.params, splats.stride, draw.first, draw.slots,
                       source_ids_.view(), moment1, moment2);
    run(PlaceCopies{splats, draw.first, draw.slots, source_ids_.view(), draw.spread, draw.purpose, draw.seed,
                    draw.iteration});
  }

  Device& device_;
  std::size_t rows_, trained_rows_;  // number of rows of all parameters, and of the trained ones
  Kernels step_, draws_;
  Sums sums_;
  Buffer<u32> weights_, copy_counts_, source_ids_, totals_;
  Buffer<u64> prefix_;
};

}  // namespace ubs
