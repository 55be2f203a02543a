// SPDX-License-Identifier: Apache-2.0
// The kernel camera_backward of kernels/map/camera.cl, compiled as CUDA. It computes the gradient of the
// camera. Requires UBS_CAMERA_GRAD.
// clang-format off
#include "kernels/map/records.h"
#include "kernels/map/project.cl"
#include "kernels/map/camera.cl"
// clang-format on
