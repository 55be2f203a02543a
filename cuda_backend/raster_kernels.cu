// SPDX-License-Identifier: Apache-2.0
// The rasterisers and the sum over slots (contracts: host/device/stages.hpp). No float atomics and a fixed
// order of all sums: the same inputs give the same bits.
#include <cuda_runtime.h>
#include <math.h>

#include "cuda_backend/kernels.hpp"

#define UBS_VW 1

namespace ubs::cuda {
namespace {

#include "cuda_backend/shared_math.cuh"
// clang-format off
#include "cuda_backend/tile_raster.cuh"
#include "cuda_backend/raster_forward.cuh"
#include "cuda_backend/raster_backward.cuh"
// clang-format on

static_assert(kForwardBatch == static_cast<int>(kTileBlock) && kQueue == static_cast<int>(kTileBlock));

// 16 neighbouring threads a splat, so that a slot is one coalesced read of 64 bytes. Slots of mask 0 were
// never written: they may hold anything, NaN included.
__global__ void __launch_bounds__(kSumBlock)
    sum_slots(unsigned count, const unsigned* tile_counts, const unsigned* slot_offsets, const float* slots,
              const unsigned short* masks, float* v_records) {
  const size_t item = static_cast<size_t>(blockIdx.x) * blockDim.x + threadIdx.x;
  const size_t splat = item / UBS_GRAD_STRIDE;
  const unsigned value = static_cast<unsigned>(item % UBS_GRAD_STRIDE);
  if (splat >= count) return;
  float sum = 0.0f;
  const unsigned tiles = tile_counts[splat];
  const size_t first = tiles > 0 ? slot_offsets[splat] : 0;
  for (size_t slot = first; slot < first + tiles; ++slot)
    if (masks[slot] != 0) sum += slots[slot * UBS_GRAD_STRIDE + value];
  v_records[splat * UBS_GRAD_STRIDE + value] = sum;
}

}  // namespace

RasterKernels raster_kernels(bool depth) {
  return {depth ? raster_forward<true> : raster_forward<false>, raster_backward, sum_slots};
}

}  // namespace ubs::cuda
