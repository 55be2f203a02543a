// SPDX-License-Identifier: Apache-2.0
#include "cuda_backend/cuda_raster.hpp"

#include "cuda_backend/grid.hpp"
#include "host/device/operation_checks.hpp"
#include "host/device/stage_sizes.hpp"
#include "kernels/layout.h"

namespace ubs::cuda {
namespace {

void require(bool holds, std::string_view what) {
  if (!holds) fail(ErrorKind::internal, "raster: {}", what);
}

unsigned tiles(const ImageShape& shape) { return static_cast<unsigned>(shape.tiles()); }

constexpr unsigned kTileThreads = kTileSide * kTileSide;  // threads per block: one per pixel

}  // namespace

Raster::Raster(CudaDevice& device, const KernelConfig& config)
    : device_(device), config_(config), kernels_(raster_kernels(device, config)) {}

void Raster::run(const RasterForward& work) {
  check_raster(work, work.masks.size > 0);
  if (work.masks.size > 0) check_list_states(work);
  require(work.transmittance.size >= work.shape.plane(), "the buffer for the transmittance is too small");
  require(!config_.depth || work.depth.size >= work.shape.plane(), "the buffer for the depth is too small");
  const ImageShape& shape = work.shape;
  const auto parts = work.long_lists.size == 0
                         ? 0
                         : static_cast<unsigned>(stage_sizes::list_parts(
                               work.sorted_ids.size, config_.depth, device_.info().max_allocation_bytes));
  if (parts > 0) {
    reserve(device_, parts_, "parts of long lists", parts * stage_sizes::list_part_floats(config_.depth));
    device_.launch("raster_parts", kernels_.parts, parts, kTileThreads, work.records, work.sorted_ids,
                   work.tile_ranges, shape.tiles_x(), shape.tiles_y(), shape.width, shape.height,
                   work.long_lists, parts_.view());
  }
  device_.launch("raster_forward", kernels_.forward, tiles(shape) + parts, kTileThreads, work.records,
                 work.sorted_ids, work.sorted_slots, work.tile_ranges, shape.tiles_x(), shape.tiles_y(),
                 shape.width, shape.height, work.background[0], work.background[1], work.background[2],
                 work.image, work.transmittance, work.depth, work.masks, work.states, work.long_lists,
                 parts > 0 ? parts_.view() : BufferView<float>{});
  if (parts > 0)
    device_.launch("raster_join", kernels_.join, tiles(shape), kTileThreads, work.tile_ranges,
                   shape.tiles_x(), shape.tiles_y(), shape.width, shape.height, work.background[0],
                   work.background[1], work.background[2], work.image, work.transmittance, work.depth,
                   work.states, work.long_lists, parts_.view());
}

void Raster::run(const RasterBackward& work) {
  check_backward(config_, "raster backward");
  check_raster(work, true);
  check_list_states(work);
  check_channels(config_, work);
  // In CUDA, a single buffer may be as large as the memory of the device, so slots are never divided.
  require(work.slots.count <= 1, "the slots must be in a single buffer");
  device_.launch("raster_backward", kernels_.backward, static_cast<unsigned>(list_segments(work)),
                 kTileThreads, work.records, work.sorted_ids, work.sorted_slots, work.tile_ranges,
                 work.shape.tiles_x(), work.shape.tiles_y(), work.shape.width, work.shape.height, work.image,
                 work.v_image, work.masks, work.states, work.more_colours, work.v_more, work.more_channels,
                 work.slots.pieces[0]);
}

void Raster::run(const SumSlots& work) {
  check_backward(config_, "sum of slots");
  require(work.tile_counts.size >= work.count && work.slot_offsets.size >= work.count,
          "tile_counts or slot_offsets has fewer elements than there are splats");
  require(work.v_records.size >= static_cast<std::size_t>(work.count) * kGradStride,
          "v_records has fewer rows than there are splats");
  device_.launch("sum_slots", kernels_.sum_slots, blocks(std::uint64_t{work.count} * kGradStride, kSumBlock),
                 kSumBlock, work.count, work.tile_counts, work.slot_offsets, work.slots.pieces[0], work.masks,
                 work.v_records);
}

void Raster::run(const MeasureWeights& work) {
  check_weights(work);
  if (!weights_) weights_ = weight_kernels(device_, config_);
  device_.launch("measure_weights", weights_->measure, tiles(work.shape), kTileThreads, work.records,
                 work.sorted_ids, work.sorted_slots, work.tile_ranges, work.shape.tiles_x(),
                 work.shape.tiles_y(), work.shape.width, work.shape.height, work.masks, work.weights);
}

}  // namespace ubs::cuda
