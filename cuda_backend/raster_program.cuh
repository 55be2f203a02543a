// SPDX-License-Identifier: Apache-2.0
// This program contains the rasterisers and the sum over gradient slots. Its kernels are raster_gpu_parts,
// raster_gpu_forward, raster_gpu_join and, unless UBS_FORWARD_ONLY is set, raster_gpu_backward and
// sum_slots_scalar.
#define UBS_TOGETHER 3
#define UBS_BACKWARD_BATCH 192  // so that three work-groups fit on GPUs with 100 KiB of shared memory
#define UBS_SUM_GROUP_GPU 256
// clang-format off
#include "kernels/gpu/words.h"
#include "kernels/gpu/exchange.h"
#include "kernels/gpu/list_segments.h"
#include "kernels/gpu/list_parts.h"
#include "kernels/gpu/tile.h"
#include "kernels/gpu/raster_forward.cl"
#if !UBS_FORWARD_ONLY
#include "kernels/dialect/slot_pieces.h"
#include "kernels/gpu/raster_backward.cl"
#include "kernels/gpu/sum_slots.cl"
#endif
// clang-format on
