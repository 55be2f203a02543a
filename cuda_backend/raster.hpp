// SPDX-License-Identifier: Apache-2.0
// The rasterisers, the sum over slots and the weights of splats. Contracts: RasterForward, RasterBackward,
// SumSlots and MeasureWeights in host/device/stages.hpp. KernelConfig::raster makes no difference here.
#pragma once

#include <optional>

#include "cuda_backend/kernel_choice.hpp"
#include "cuda_backend/tile_order.hpp"
#include "host/device/stages.hpp"

namespace ubs::cuda {

class Raster {
 public:
  Raster(CudaDevice& device, const KernelConfig& config);

  void forward(const RasterForward& work);
  void backward(const RasterBackward& work);
  void sum_slots(const SumSlots& work);
  void measure_weights(const MeasureWeights& work);

 private:
  // What the tuned constants of a pass say (cuda_backend/tuning.hpp).
  struct Turns {
    bool longest_first = false;
    unsigned resident = 0;  // blocks; 0: as many as tiles
  };
  struct Launch {
    dim3 grid;
    View1<u32> order, taken;
  };
  bool by_splats() const { return config_.backward && config_.splat_backward; }
  Launch launch_of(const Turns& turns, unsigned tiles) const;

  CudaDevice& device_;
  KernelConfig config_;
  RasterKernels kernels_;
  // Only with KernelConfig::splat_backward: states of pixels before buckets, and whose lists they are of.
  Buffer<float> states_;
  const Memory* states_of_ = nullptr;
  Turns forward_, backward_;
  TileOrder order_;
  Buffer<u32> taken_;                     // (1), for resident blocks
  std::optional<WeightKernels> weights_;  // made at its first use
};

}  // namespace ubs::cuda
