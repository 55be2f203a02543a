// SPDX-License-Identifier: Apache-2.0
// The rasterisers and the sum over slots (contracts: host/device/stages.hpp), compiled once for each of the names that
// kernels.hpp has: as `plain`, or as UBS_RASTER_FORM with the switches that it stands for.
// No float atomics and a fixed order of all sums: the same inputs give the same bits.
#include <cuda_runtime.h>
#include <math.h>

#include "cuda_backend/kernels.hpp"

#define UBS_VW 1

namespace ubs::cuda {
namespace {

#include "cuda_backend/shared_math.cuh"
// clang-format off
#include "cuda_backend/raster_program.cuh"
#ifndef UBS_RASTER_FORM
#include "cuda_backend/raster_weights.cuh"
#endif
// clang-format on

static_assert(kSumThreads == static_cast<int>(kSumBlock));
#ifdef UBS_SPLAT_BACKWARD
static_assert(kBucket == kBucketEntries && kSplatWarps == static_cast<int>(kBucketWarps));
#endif

}  // namespace

#ifdef UBS_RASTER_FORM
RasterKernels UBS_PASTE(raster_kernels_, UBS_RASTER_FORM)() { return {raster_forward, raster_backward, sum_slots}; }
#else
RasterKernels raster_kernels_plain() { return {raster_forward, raster_backward, sum_slots}; }
WeightKernels weight_kernels_plain() { return {measure_weights}; }
#endif

}  // namespace ubs::cuda
