// SPDX-License-Identifier: Apache-2.0
// Compiles the kernels of the learnt sky behind the splats (kernels/map/sky.cl and sky_step.cl) as CUDA. The
// colour of the sky is a sum of spherical harmonics up to degree 2.
#include <cuda_runtime.h>
#include <math.h>

#include "cuda_backend/cuda_kernels.hpp"

#define UBS_VW 1
#define UBS_COLOUR 3

namespace ubs::cuda {
namespace {

#include "cuda_backend/shared_math.cuh"
// clang-format off
#include "kernels/map/row_sums.cl"
#include "kernels/map/sky.h"
#include "kernels/map/sky.cl"
#include "kernels/map/sky_step.cl"
// clang-format on

}  // namespace

SkyTable sky_kernels() { return {draw_sky, sky_vjp, row_sums, sky_gradient, sky_step}; }

}  // namespace ubs::cuda
