// SPDX-License-Identifier: Apache-2.0
// The projection kernels project_forward and project_backward of kernels/map, compiled as CUDA.
// clang-format off
#include "kernels/map/records.h"
#include "kernels/map/project.cl"
// clang-format on
