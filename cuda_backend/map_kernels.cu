// SPDX-License-Identifier: Apache-2.0
// Compiles two kinds of kernels of kernels/map as CUDA: those that project splats, and those that change their
// parameters. The build compiles this file once for each number of dimensions UBS_N from 3 to 7.
#include <cuda_runtime.h>
#include <math.h>

#include "cuda_backend/cuda_kernels.hpp"

#define UBS_VW 1

namespace ubs::cuda {
namespace {

#include "cuda_backend/shared_math.cuh"
// clang-format off
#include "cuda_backend/map_project.cuh"
#include "cuda_backend/map_parameters.cuh"
// clang-format on

}  // namespace

template <>
ProjectKernels project_kernels_of<UBS_N>() {
  return {project_forward, project_backward};
}
template <>
ParameterKernels parameter_kernels_of<UBS_N>() {
  return {adam_step,    adam_step_watched, regularise,   add_noise,
          mcmc_weights, mcmc_draw,         mcmc_sources, mcmc_copies, mcmc_places};
}

}  // namespace ubs::cuda
