// SPDX-License-Identifier: Apache-2.0
#include "cuda_backend/raster.hpp"

#include "cuda_backend/grid.hpp"
#include "host/device/stage_checks.hpp"
#include "kernels/layout.h"

namespace ubs::cuda {
namespace {

void require(bool holds, std::string_view what) {
  if (!holds) fail(ErrorKind::internal, "raster: {}", what);
}

unsigned tiles(const ImageShape& shape) { return static_cast<unsigned>(shape.tiles()); }

constexpr unsigned kTileThreads = UBS_TILE * UBS_TILE;  // of a block: one a pixel

}  // namespace

Raster::Raster(CudaDevice& device, const KernelConfig& config)
    : device_(device), config_(config), order_(device) {
  const TuningValues& tuning = device.info().tuning;
  const unsigned forward = tuned_value(tuning, kForwardTurns, 0),
                 backward = config.backward && !by_splats() ? tuned_value(tuning, kBackwardTurns, 0) : 0;
  kernels_ = raster_kernels(device, config, forward != 0 || backward != 0);
  const auto turns = [&](unsigned value, const auto& kernel) {
    return Turns{(value & kLongestFirst) != 0,
                 (value & kResidentBlocks) != 0 ? device.resident_blocks(kernel, kTileThreads) : 0};
  };
  forward_ = turns(forward, kernels_.forward);
  backward_ = turns(backward, kernels_.backward);
  if (forward_.resident == 0 && backward_.resident == 0) return;
  taken_ = Buffer<u32>(device, "turns of tiles", 1);
  taken_.zero();
}

Raster::Launch Raster::launch_of(const Turns& turns, unsigned tiles) const {
  const bool fewer = turns.resident > 0 && turns.resident < tiles;
  return {fewer ? turns.resident : tiles, turns.longest_first ? order_.view() : View1<u32>{}, taken_.view()};
}

void Raster::forward(const RasterForward& work) {
  check_raster(work, config_.backward);
  require(work.transmittance.size >= work.shape.plane(), "transmittance smaller than its plane");
  require(!config_.depth || work.depth.size >= work.shape.plane(), "depth smaller than its plane");
  if (by_splats()) {
    reserve(device_, states_, "pixel states", work.sorted_ids.size / kBucketEntries * kTileThreads * 4);
    states_of_ = work.tile_ranges.memory;
  }
  if (forward_.longest_first || backward_.longest_first) order_.make(work.tile_ranges, tiles(work.shape));
  const Launch launch = launch_of(forward_, tiles(work.shape));
  device_.launch("raster_forward", kernels_.forward, launch.grid, kTileThreads, work.records,
                 work.sorted_ids, work.sorted_slots, work.tile_ranges, work.shape.tiles_x(),
                 work.shape.tiles_y(), work.shape.width, work.shape.height, work.background[0],
                 work.background[1], work.background[2], work.image, work.transmittance, work.depth,
                 work.masks, states_.view(), launch.order, launch.taken);
}

void Raster::backward(const RasterBackward& work) {
  check_backward(config_, "raster backward");
  check_raster(work, true);
  require(work.v_image.size >= 3 * work.shape.plane(), "v_image smaller than its three planes");
  require(work.slots.count <= 1, "slots in several pieces");  // an allocation may take all of the memory
  require(!config_.atomics || work.v_records.size > 0, "no gradients of splats to add to");
  require(!by_splats() || states_of_ == work.tile_ranges.memory,
          "another view was drawn before its backward");
  if (backward_.longest_first && !order_.fits(tiles(work.shape)))
    order_.make(work.tile_ranges, tiles(work.shape));
  const Launch launch = launch_of(backward_, tiles(work.shape));
  // With splats one warp a place of a bucket.
  const std::uint64_t buckets =
      work.sorted_ids.size / kBucketEntries + static_cast<std::uint64_t>(work.shape.tiles());
  const dim3 grid = by_splats() ? dim3(blocks(buckets, kBucketWarps)) : launch.grid;
  const unsigned threads = by_splats() ? 32 * kBucketWarps : kTileThreads;
  device_.launch("raster_backward", kernels_.backward, grid, threads, work.records, work.sorted_ids,
                 work.sorted_slots, work.tile_ranges, work.shape.tiles_x(), work.shape.tiles_y(),
                 work.shape.width, work.shape.height, work.image, work.v_image, work.masks,
                 config_.atomics ? work.v_records : work.slots.pieces[0], states_.view(), launch.order,
                 launch.taken);
}

void Raster::sum_slots(const SumSlots& work) {
  check_backward(config_, "sum of slots");
  if (config_.atomics) return;  // there is nothing left to add
  require(work.tile_counts.size >= work.count && work.slot_offsets.size >= work.count,
          "tile_counts or slot_offsets shorter than count");
  require(work.v_records.size >= static_cast<std::size_t>(work.count) * UBS_GRAD_STRIDE,
          "v_records shorter than count");
  device_.launch("sum_slots", kernels_.sum_slots,
                 blocks(std::uint64_t{work.count} * UBS_GRAD_STRIDE, kSumBlock), kSumBlock, work.count,
                 work.tile_counts, work.slot_offsets, work.slots.pieces[0], work.masks, work.v_records);
}

void Raster::measure_weights(const MeasureWeights& work) {
  check_weights(work);
  if (!weights_) weights_ = weight_kernels(device_, config_);
  device_.launch("measure_weights", weights_->measure, tiles(work.shape), kTileThreads, work.records,
                 work.sorted_ids, work.sorted_slots, work.tile_ranges, work.shape.tiles_x(),
                 work.shape.tiles_y(), work.shape.width, work.shape.height, work.masks, work.partners,
                 work.others, work.weights, work.changes, work.stops);
}

}  // namespace ubs::cuda
