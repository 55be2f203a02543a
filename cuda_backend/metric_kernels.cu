// SPDX-License-Identifier: Apache-2.0
// Compiles the kernels of image metrics (kernels/map/network.cl and ssim_valid.cl) as CUDA.
#include <cuda_runtime.h>
#include <math.h>

#include "cuda_backend/cuda_kernels.hpp"

#define UBS_VW 1

namespace ubs::cuda {
namespace {

#include "cuda_backend/shared_math.cuh"
// clang-format off
#include "kernels/math/lpips.h"
#include "kernels/map/network.cl"
#include "kernels/map/ssim_valid.cl"
// clang-format on

}  // namespace

MetricKernels metric_kernels() {
  return {load_image, im2col, bias_relu, max_pool, lpips_distance, partial_sums, ssim_rows, ssim_columns};
}

}  // namespace ubs::cuda
