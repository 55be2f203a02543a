// SPDX-License-Identifier: Apache-2.0
// The shared kernels of measured ceilings (kernels/map/ceilings.cl) as CUDA.
#include <cuda_runtime.h>
#include <math.h>

#include "cuda_backend/kernels.hpp"

#define UBS_VW 1

namespace ubs::cuda {
namespace {

#include "cuda_backend/shared_math.cuh"
// clang-format off
#include "kernels/map/ceilings.cl"
// clang-format on

}  // namespace

CeilingFunctions ceiling_functions() { return {ceiling_fma, ceiling_read, ceiling_write, ceiling_update}; }

}  // namespace ubs::cuda
