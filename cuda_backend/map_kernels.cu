// SPDX-License-Identifier: Apache-2.0
// The shared map kernels (kernels/map) as CUDA, compiled once for each UBS_N, again with UBS_QUERY_GRAD
// for the projection alone, on which nothing else depends, and with UBS_CAMERA_GRAD for the camera's gradient.
#include <cuda_runtime.h>
#include <math.h>

#include "cuda_backend/kernels.hpp"

#define UBS_VW 1

namespace ubs::cuda {
namespace {

#include "cuda_backend/shared_math.cuh"
// clang-format off
#ifdef UBS_CAMERA_GRAD
#include "cuda_backend/map_camera.cuh"
#else
#include "cuda_backend/map_project.cuh"
#endif
#if !defined(UBS_QUERY_GRAD) && !defined(UBS_CAMERA_GRAD)
#include "cuda_backend/map_parameters.cuh"
#endif
// clang-format on

}  // namespace

#ifdef UBS_CAMERA_GRAD
CameraKernels UBS_PASTE(camera_kernels_, UBS_N)() { return {camera_backward}; }
#elif defined(UBS_QUERY_GRAD)
ProjectKernels UBS_PASTE(project_kernels_query_, UBS_N)() { return {project_forward, project_backward}; }
#else
ProjectKernels UBS_PASTE(project_kernels_, UBS_N)() { return {project_forward, project_backward}; }
ParameterKernels UBS_PASTE(parameter_kernels_, UBS_N)() {
  return {adam_step, adam_step_watched, regularise, add_noise, mcmc_weights, mcmc_sources, mcmc_copies};
}
#endif

}  // namespace ubs::cuda
