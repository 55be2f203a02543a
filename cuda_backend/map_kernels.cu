// SPDX-License-Identifier: Apache-2.0
// The shared map kernels (kernels/map) as CUDA, compiled once for each UBS_N, again with UBS_QUERY_GRAD
// for the projection alone, on which nothing else depends, and with UBS_CAMERA_GRAD for the camera's
// gradient.
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
template <>
CameraKernels camera_kernels_of<UBS_N>() {
  return {camera_backward};
}
#elif defined(UBS_QUERY_GRAD)
template <>
ProjectKernels query_project_kernels_of<UBS_N>() {
  return {project_forward, project_backward};
}
#else
template <>
ProjectKernels project_kernels_of<UBS_N>() {
  return {project_forward, project_backward};
}
template <>
ParameterKernels parameter_kernels_of<UBS_N>() {
  return {adam_step,    adam_step_watched, regularise,   add_noise,
          mcmc_weights, mcmc_draw,         mcmc_sources, mcmc_copies};
}
#endif

}  // namespace ubs::cuda
