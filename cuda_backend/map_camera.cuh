// SPDX-License-Identifier: Apache-2.0
// Compiles the kernel camera_backward of kernels/map/camera.cl as CUDA. The kernel computes the gradient of
// the camera. The macro UBS_CAMERA_GRAD must be 1.
// clang-format off
#include "kernels/map/records.h"
#include "kernels/map/arrays.h"
#include "kernels/map/project.cl"
#include "kernels/map/camera.cl"
// clang-format on
