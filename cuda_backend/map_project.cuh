// SPDX-License-Identifier: Apache-2.0
// The projection of kernels/map as CUDA: project_forward, project_backward.
// clang-format off
#include "kernels/map/records.h"
#include "kernels/map/project.cl"
// clang-format on
