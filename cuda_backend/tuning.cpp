// SPDX-License-Identifier: Apache-2.0
#include "cuda_backend/tuning.hpp"

#include "cuda_backend/kernels.hpp"

namespace ubs::cuda {

const std::vector<TunedConstant>& tuned_constants() {
  constexpr RasterKind gpu = RasterKind::gpu;  // there are no others here
  static const std::vector<TunedConstant> all{
      {kForwardTurns, 0, {1, 2, 3}, "cuda_backend/tile_turns.cuh", gpu, {"raster_forward"}},
      // Forward makes the order for both.
      {kBackwardTurns,
       0,
       {1, 2, 3},
       "cuda_backend/tile_turns.cuh",
       gpu,
       {"raster_forward", "raster_backward"}},
      // Forward writes states for it.
      {kTunedSplatBackward,
       0,
       {1},
       "cuda_backend/raster_backward_splats.cuh",
       gpu,
       {"raster_forward", "raster_backward"}},
      {kTunedMapBlock,
       kMapBlock,
       {64, 256},
       "cuda_backend/parameters.cpp",
       gpu,
       {"project_forward", "project_backward", "adam"}},
      {kTunedAtomics, 0, {1}, "cuda_backend/raster_backward.cuh", gpu, {"forward_backward"}, true},
  };
  return all;
}

}  // namespace ubs::cuda
