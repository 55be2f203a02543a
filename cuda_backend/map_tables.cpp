// SPDX-License-Identifier: Apache-2.0
// Selects, by the number of dimensions, the map kernels that were compiled ahead of time.
#include "cuda_backend/cuda_kernels.hpp"
#include "host/base/error.hpp"

namespace ubs::cuda {
namespace {

template <int n, typename Of>
auto of_dim(int dim, const Of& of) {
  if (dim == n) return of.template operator()<n>();
  if constexpr (n < kLastDimAhead) return of_dim<n + 1>(dim, of);
  fail(ErrorKind::internal, "no kernels for {} dimensions have been compiled ahead of time", dim);
}

}  // namespace

ProjectKernels compiled_project_kernels(int dim) {
  return of_dim<3>(dim, []<int n>() { return project_kernels_of<n>(); });
}

ParameterKernels compiled_parameter_kernels(int dim) {
  return of_dim<3>(dim, []<int n>() { return parameter_kernels_of<n>(); });
}

}  // namespace ubs::cuda
