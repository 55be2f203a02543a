// SPDX-License-Identifier: Apache-2.0
// What splats do to pixels, as a program of its own: measure_weights.
// clang-format off
#include "cuda_backend/tile_raster.cuh"
#include "cuda_backend/raster_weights.cuh"
// clang-format on
