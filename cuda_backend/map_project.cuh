// SPDX-License-Identifier: Apache-2.0
// Compiles the projection kernels project_forward and project_backward of kernels/map as CUDA.
// clang-format off
#include "kernels/map/records.h"
#include "kernels/map/arrays.h"
#include "kernels/map/project.cl"
// clang-format on
