// SPDX-License-Identifier: Apache-2.0
// The gradient of the camera (kernels/map) as CUDA. Requires UBS_CAMERA_GRAD.
// clang-format off
#include "kernels/map/records.h"
#include "kernels/map/project.cl"
#include "kernels/map/camera.cl"
// clang-format on
