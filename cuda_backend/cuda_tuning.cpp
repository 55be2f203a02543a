// SPDX-License-Identifier: Apache-2.0
#include "cuda_backend/cuda_tuning.hpp"

#include "cuda_backend/cuda_kernels.hpp"

namespace ubs::cuda {

const std::vector<TunedConstant>& tuned_constants() {
  constexpr RasterKind gpu = RasterKind::gpu;  // the only kind in CUDA
  static const std::vector<TunedConstant> all{
      {kTunedMapBlock,
       kMapBlock,
       {64, 256},
       "cuda_backend/cuda_projection.cpp",
       gpu,
       {"project_forward", "project_backward", "adam"}},
  };
  return all;
}

}  // namespace ubs::cuda
