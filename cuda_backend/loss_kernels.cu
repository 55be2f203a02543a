// SPDX-License-Identifier: Apache-2.0
// This file contains the kernels of the image loss (kernels/gpu/loss.cl), once without and once with a mask,
// the kernels of the appearance of photographs (kernels/map/appearance.cl and appearance_step.cl), and those
// that convert gradients of images (kernels/map/image_gradient.cl).
#include <cuda_runtime.h>
#include <math.h>

#include "cuda_backend/cuda_kernels.hpp"

#define UBS_VW 1
#define UBS_LOSS_TILE_GPU ubs::cuda::kLossTileX
#define UBS_LOSS_GROUP 128

namespace ubs::cuda {
namespace {

#include "cuda_backend/shared_math.cuh"
// clang-format off
#include "kernels/gpu/words.h"
#include "kernels/math/appearance.h"
#include "kernels/map/row_sums.cl"
#include "kernels/map/appearance.cl"
#include "kernels/map/appearance_step.cl"
#include "kernels/map/image_gradient.cl"

namespace plain {
#include "kernels/gpu/loss.cl"
}
namespace masked {
#define UBS_LOSS_MASK 1
#include "kernels/gpu/loss.cl"
}
// clang-format on

static_assert(LOSS_GROUP == kLossBlock && LOSS_TOTAL_GROUP == kLossTotalBlock);

}  // namespace

AppearanceTable appearance_kernels() {
  return {map_colours, map_colours_vjp, row_sums, appearance_gradient, appearance_step};
}

ImageGradientTable image_gradient_kernels() {
  return {alpha_to_colours, depth_sums,     row_sums,          depth_mean,
          depth_to_records, depth_to_image, depth_from_records};
}

LossKernels loss_kernels(bool with_mask) {
  if (with_mask)
    return {masked::loss_margins, masked::loss_window, masked::loss_gradient, masked::loss_total};
  return {plain::loss_margins, plain::loss_window, plain::loss_gradient, plain::loss_total};
}

}  // namespace ubs::cuda
