// SPDX-License-Identifier: Apache-2.0
// Finds the copy of the compiled map kernels for a number of dimensions.
#include "cuda_backend/kernels.hpp"
#include "host/base/error.hpp"

namespace ubs::cuda {

// Below 6 dimensions no view direction is queried, hence no gradient passes through it.
#define UBS_EACH_DIM(apply) apply(3) apply(4) apply(5) apply(6) apply(7) apply(8) apply(9) apply(10) apply(11)
#define UBS_EACH_QUERY_DIM(apply) apply(6) apply(7) apply(8) apply(9) apply(10) apply(11)

#define UBS_DECLARE(n)                  \
  ProjectKernels project_kernels_##n(); \
  CameraKernels camera_kernels_##n();   \
  ParameterKernels parameter_kernels_##n();
UBS_EACH_DIM(UBS_DECLARE)
#define UBS_DECLARE_QUERY(n) ProjectKernels project_kernels_query_##n();
UBS_EACH_QUERY_DIM(UBS_DECLARE_QUERY)

#define UBS_PROJECT(n) \
  case n:              \
    return project_kernels_##n();
#define UBS_PROJECT_QUERY(n) \
  case n:                    \
    return project_kernels_query_##n();
#define UBS_CAMERA(n) \
  case n:             \
    return camera_kernels_##n();
#define UBS_PARAMETER(n) \
  case n:                \
    return parameter_kernels_##n();

ProjectKernels compiled_project_kernels(int dim, bool query_grad) {
  if (query_grad) switch (dim) {
      UBS_EACH_QUERY_DIM(UBS_PROJECT_QUERY)
    }
  switch (dim) { UBS_EACH_DIM(UBS_PROJECT) }
  fail(ErrorKind::usage, "splats have 3 to 11 dimensions, not {}", dim);
}

CameraKernels compiled_camera_kernels(int dim) {
  switch (dim) { UBS_EACH_DIM(UBS_CAMERA) }
  fail(ErrorKind::usage, "splats have 3 to 11 dimensions, not {}", dim);
}

ParameterKernels compiled_parameter_kernels(int dim) {
  switch (dim) { UBS_EACH_DIM(UBS_PARAMETER) }
  fail(ErrorKind::usage, "splats have 3 to 11 dimensions, not {}", dim);
}

}  // namespace ubs::cuda
