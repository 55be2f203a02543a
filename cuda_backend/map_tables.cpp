// SPDX-License-Identifier: Apache-2.0
// Finds the copy of the compiled map kernels for a number of dimensions.
#include "cuda_backend/kernels.hpp"
#include "host/base/error.hpp"

namespace ubs::cuda {
namespace {

constexpr int kFirstWithDirection = 6;  // below, no gradient passes through a view direction

template <int n, typename Of>
auto of_dim(int dim, const Of& of) {
  if (dim == n) return of.template operator()<n>();
  if constexpr (n < kLastDimAhead) return of_dim<n + 1>(dim, of);
  fail(ErrorKind::internal, "no kernels of {} dimensions are compiled ahead", dim);
}

}  // namespace

ProjectKernels compiled_project_kernels(int dim, bool query_grad) {
  if (query_grad && dim >= kFirstWithDirection)
    return of_dim<kFirstWithDirection>(dim, []<int n>() { return query_project_kernels_of<n>(); });
  return of_dim<3>(dim, []<int n>() { return project_kernels_of<n>(); });
}

CameraKernels compiled_camera_kernels(int dim) {
  return of_dim<3>(dim, []<int n>() { return camera_kernels_of<n>(); });
}

ParameterKernels compiled_parameter_kernels(int dim) {
  return of_dim<3>(dim, []<int n>() { return parameter_kernels_of<n>(); });
}

}  // namespace ubs::cuda
