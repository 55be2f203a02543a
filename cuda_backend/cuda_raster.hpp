// SPDX-License-Identifier: Apache-2.0
// Raster runs the rasterisers, the sum over gradient slots, and the measurement of the weights of splats.
// Their contracts are described at RasterForward, RasterBackward, SumSlots and MeasureWeights in
// host/device/stages.hpp. KernelConfig::raster has no effect, because CUDA has only the rasterisers with one
// thread per pixel.
#pragma once

#include <optional>

#include "cuda_backend/kernel_choice.hpp"
#include "host/device/stages.hpp"

namespace ubs::cuda {

class Raster {
 public:
  Raster(CudaDevice& device, const KernelConfig& config);

  void run(const RasterForward& work);
  void run(const RasterBackward& work);
  void run(const SumSlots& work);
  void run(const MeasureWeights& work);

 private:
  CudaDevice& device_;
  KernelConfig config_;
  RasterKernels kernels_;
  std::optional<WeightKernels> weights_;  // set at the first use
  Buffer<float> parts_;                   // parts of long lists
};

}  // namespace ubs::cuda
