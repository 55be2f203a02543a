// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/raster.hpp"

#include <string_view>

#include "host/base/warning.hpp"
#include "host/device/operation_checks.hpp"
#include "host/device/stage_sizes.hpp"
#include "host/opencl/opencl_tuning.hpp"
#include "kernels/layout.h"

namespace ubs::opencl {
namespace {

constexpr std::size_t kGpuGroup = kTileSide * kTileSide;  // one work-item per pixel

bool on_cpu(const KernelConfig& config) { return config.raster == RasterKind::cpu; }

// Returns the sources that all programs with a rasteriser share. On CPUs these include the rasteriser itself.
ProgramSpec raster_program(const OpenclDevice& device, const KernelConfig& config, Exchange exchange,
                           bool pieces = false) {
  const unsigned width = on_cpu(config) ? device.vector_width() : 1;
  ProgramSpec spec{{"dialect/entry.h", "dialect/slot_pieces.h", "math/elementary.h", "math/falloff.h",
                    "math/blend.h", "math/cull.h", "opencl/lanes.h"},
                   {"-DUBS_VW=" + std::to_string(width)}};
  if (on_cpu(config)) {
    append(spec.sources, {"opencl/shuffles.h", "opencl/raster_cpu.cl"});
  } else {
    append(spec.sources, {"gpu/words.h", "gpu/exchange.h", "gpu/tile.h"});
    append(spec.options, exchange_options(device, exchange));
  }
  if (pieces) spec.options.push_back("-DUBS_SLOT_PIECES=1");
  append(spec.options, raster_options(config));
  return spec;
}

// Returns the program of the rasterisers. If there is a backward pass, the program includes the sum of slots.
ProgramSpec view_program(const OpenclDevice& device, const KernelConfig& config, Exchange exchange,
                         bool pieces = false) {
  ProgramSpec spec = raster_program(device, config, exchange, pieces);
  if (!on_cpu(config))
    append(spec.sources, {"gpu/list_segments.h", "gpu/list_parts.h", "gpu/raster_forward.cl"});
  if (config.backward && on_cpu(config)) spec.sources.push_back("opencl/slot_sum.cl");
  if (config.backward && !on_cpu(config))
    append(spec.sources, {"gpu/raster_backward.cl", "gpu/sum_slots.cl"});
  if (config.backward && exchange != Exchange::none) spec.sources.push_back("gpu/exchange_check.cl");
  return spec;
}

ProgramSpec weights_program(const OpenclDevice& device, KernelConfig config) {
  config.depth = false;
  ProgramSpec spec = raster_program(device, config, Exchange::none);
  spec.sources.push_back(on_cpu(config) ? "opencl/weights.cl" : "gpu/weights.cl");
  return spec;
}

// Returns the number of work-items per group of the sum of slots. With core groups, it is the number of
// splats per group of the projection, unless it is tuned.
std::size_t sum_group(const OpenclDevice& device, const KernelConfig& config, const CoreGroups& core_groups) {
  const TuningValues& tuning = device.info().tuning;
  if (!on_cpu(config)) return tuned_value(tuning, "UBS_SUM_GROUP_GPU");
  if (!core_groups) return tuned_value(tuning, "UBS_SUM_GROUP");
  return tuned_value(tuning, "UBS_SUM_GROUP", kCoreGroupItems * device.vector_width());
}

// Calls `then` with the first arguments of the kernels of the rasterisers, which are the same for all of
// them.
template <typename Work, typename Then>
void with_lists(const Work& work, const Then& then) {
  then(work.records, work.sorted_ids, work.sorted_slots, work.tile_ranges, work.shape.tiles_x(),
       work.shape.tiles_y(), work.shape.width, work.shape.height);
}

void require(bool holds, std::string_view what) {
  if (!holds) fail(ErrorKind::internal, "raster: {}", what);
}

}  // namespace

Raster::Raster(OpenclDevice& device, const KernelConfig& config)
    : device_(device),
      config_(config),
      core_groups_(device, on_cpu(config) ? cores_for_groups(device) : 0),
      sum_group_(sum_group(device, config, core_groups_)),
      weights_(device, weights_program(device, config)) {}

// Determines with which mechanism lanes can exchange values. The backward kernel is compiled, because this
// shows whether the compiler accepts the instructions and how many lanes a wave of the kernel has. Then a
// test kernel is run, because this shows whether the exchanged values are right.
Exchange Raster::exchange() {
  if (exchange_) return *exchange_;
  exchange_ = Exchange::none;
  const bool wanted = tuned_value(device_.info().tuning, "UBS_SUBGROUPS", 1) != 0;
  if (on_cpu(config_) || !config_.backward || !wanted) return *exchange_;
  const Exchange kind = exchange_kind(device_);
  std::string fault;
  if (kind == Exchange::none) {
    if (device_.info().type == DeviceType::cpu) return *exchange_;  // on CPUs, local memory is equally fast
    fault = "its driver does not support exchanging values between work-items (cl_khr_subgroup_shuffle)";
  } else {
    try {
      const ProgramSpec spec = device_.tuned(view_program(device_, config_, kind));
      fault = fault_of_rows(device_.kernel(spec, "raster_gpu_backward"), kind, {kGpuGroup});
      if (fault.empty()) fault = fault_of_values(device_, device_.kernel(spec, "exchange_check"));
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::build) throw;
      fault = error.what();
    }
  }
  if (fault.empty())
    exchange_ = kind;
  else
    warn_once(fmt::format("{}: gradients are summed through local memory, which is slower: {}",
                          device_.info().name, fault));
  return *exchange_;
}

KernelSet& Raster::raster(bool pieces) {
  const auto found = raster_.find(pieces);
  if (found != raster_.end()) return found->second;
  ProgramSpec spec = core_groups_.program(view_program(device_, config_, exchange(), pieces));
  if (core_groups_)
    append(spec.options,
           {fmt::format("-DUBS_SCATTER={}", tuned_value(device_.info().tuning, "UBS_SCATTER", 1)),
            fmt::format("-DUBS_CORE_GROUP_ITEMS={}", sum_group_)});
  return raster_.emplace(pieces, KernelSet(device_, std::move(spec))).first->second;
}

void Raster::run(const RasterForward& work) {
  check_raster(work, on_cpu(config_) ? config_.backward : work.masks.size > 0);
  if (!on_cpu(config_) && work.masks.size > 0) check_list_states(work);
  require(work.transmittance.size >= work.shape.plane(),
          "the buffer of the transmittance has fewer values than the image has pixels");
  require(!config_.depth || work.depth.size >= work.shape.plane(),
          "the buffer of the depth has fewer values than the image has pixels");
  KernelSet& kernels = raster(false);
  const auto tiles = static_cast<std::size_t>(work.shape.tiles());
  const std::size_t parts =
      on_cpu(config_) || work.long_lists.size == 0
          ? 0
          : stage_sizes::list_parts(work.sorted_ids.size, config_.depth, device_.info().max_allocation_bytes);
  if (parts > 0) {
    reserve(device_, parts_, "parts of long lists", parts * stage_sizes::list_part_floats(config_.depth));
    kernels[kRasterGpuParts](Range{parts * kGpuGroup}, Range{kGpuGroup}, work.records, work.sorted_ids,
                             work.tile_ranges, work.shape.tiles_x(), work.shape.tiles_y(), work.shape.width,
                             work.shape.height, work.long_lists, parts_.view());
  }
  const BufferView<float> handed = parts > 0 ? parts_.view() : BufferView<float>{};
  with_lists(work, [&](const auto&... lists) {
    if (on_cpu(config_))
      core_groups_.launch(kernels[kRasterCpuForward], tiles, lists..., work.background[0], work.background[1],
                          work.background[2], work.image, work.transmittance, work.depth, work.masks);
    else
      kernels[kRasterGpuForward](Range{(tiles + parts) * kGpuGroup}, Range{kGpuGroup}, lists...,
                                 work.background[0], work.background[1], work.background[2], work.image,
                                 work.transmittance, work.depth, work.masks, work.states, work.long_lists,
                                 handed);
  });
  if (parts > 0)
    kernels[kRasterGpuJoin](Range{tiles * kGpuGroup}, Range{kGpuGroup}, work.tile_ranges,
                            work.shape.tiles_x(), work.shape.tiles_y(), work.shape.width, work.shape.height,
                            work.background[0], work.background[1], work.background[2], work.image,
                            work.transmittance, work.depth, work.states, work.long_lists, parts_.view());
}

void Raster::run(const RasterBackward& work) {
  check_backward(config_, "raster backward");
  check_raster(work, true);
  if (!on_cpu(config_)) check_list_states(work);
  check_channels(config_, work);
  KernelSet& kernels = raster(work.slots.count > 1);
  with_lists(work, [&](const auto&... lists) {
    if (on_cpu(config_))
      core_groups_.launch(kernels[kRasterCpuBackward], static_cast<std::size_t>(work.shape.tiles()), lists...,
                          work.image, work.v_image, work.masks, work.more_colours, work.v_more,
                          work.more_channels, work.slots);
    else
      kernels[kRasterGpuBackward](Range{list_segments(work) * kGpuGroup}, Range{kGpuGroup}, lists...,
                                  work.image, work.v_image, work.masks, work.states, work.more_colours,
                                  work.v_more, work.more_channels, work.slots);
  });
}

void Raster::run(const SumSlots& work) {
  check_backward(config_, "sum of slots");
  require(work.tile_counts.size >= work.count && work.slot_offsets.size >= work.count,
          "tile_counts or slot_offsets is shorter than count");
  require(work.v_records.size >= static_cast<std::size_t>(work.count) * kGradStride,
          "v_records is shorter than count");
  const std::size_t items = on_cpu(config_) ? 1 : kGradStride;  // work-items per splat
  const std::size_t groups = round_up(work.count * items, sum_group_) / sum_group_;
  KernelSet& kernels = raster(work.slots.count > 1);
  const Range global{groups * sum_group_}, local{sum_group_};
  if (!on_cpu(config_))
    kernels[kSumSlotsScalar](global, local, work.count, work.tile_counts, work.slot_offsets, work.slots,
                             work.masks, work.v_records);
  else if (core_groups_)
    core_groups_.launch(kernels[kSumSlotsVector], groups, work.count, work.tile_counts, work.slot_offsets,
                        work.slots, work.masks, work.records, work.v_records);
  else
    kernels[kSumSlotsVector](global, local, work.count, work.tile_counts, work.slot_offsets, work.slots,
                             work.masks, work.records, work.v_records);
}

void Raster::run(const MeasureWeights& work) {
  check_weights(work);
  const std::size_t items = on_cpu(config_) ? 1 : kGpuGroup;  // work-items per tile
  weights_[kMeasureWeights]({static_cast<std::size_t>(work.shape.tiles()) * items}, {items}, work.records,
                            work.sorted_ids, work.sorted_slots, work.tile_ranges, work.shape.tiles_x(),
                            work.shape.tiles_y(), work.shape.width, work.shape.height, work.masks,
                            work.weights);
}

}  // namespace ubs::opencl
