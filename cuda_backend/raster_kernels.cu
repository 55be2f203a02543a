// SPDX-License-Identifier: Apache-2.0
// Compiles the rasterisers, the sum over gradient slots and the measurement of weights as CUDA. Their
// contracts are in host/device/stages.hpp. The build compiles this file once without and once with UBS_DEPTH.
// There are no float atomics, and all sums have a fixed order, so the same inputs give bit-identical results.
#include <cuda_runtime.h>
#include <math.h>

#include "cuda_backend/cuda_kernels.hpp"

#define UBS_VW 1

namespace ubs::cuda {
namespace {

#include "cuda_backend/shared_math.cuh"
// clang-format off
#include "cuda_backend/raster_program.cuh"
#if !UBS_DEPTH
#include "kernels/gpu/weights.cl"
#endif
// clang-format on

static_assert(UBS_SUM_GROUP_GPU == kSumBlock);
RasterKernels raster_kernels() {
  return {raster_gpu_parts, raster_gpu_forward, raster_gpu_join, raster_gpu_backward, sum_slots_scalar};
}

}  // namespace

#if UBS_DEPTH
RasterKernels raster_kernels_depth() { return raster_kernels(); }
#else
RasterKernels raster_kernels_plain() { return raster_kernels(); }
WeightKernels weight_kernels_plain() { return {measure_weights}; }
#endif

}  // namespace ubs::cuda
