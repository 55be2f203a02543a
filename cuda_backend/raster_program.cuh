// SPDX-License-Identifier: Apache-2.0
// The rasterisers and the sum over slots as one program: raster_forward, raster_backward, sum_slots.
// clang-format off
#include "kernels/map/list_segments.h"
#include "cuda_backend/tile_raster.cuh"
#include "cuda_backend/raster_forward.cuh"
#if !UBS_FORWARD_ONLY
#include "cuda_backend/raster_visit.cuh"
#include "cuda_backend/raster_backward.cuh"
#include "cuda_backend/sum_slots.cuh"
#endif
// clang-format on
