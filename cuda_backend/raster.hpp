// SPDX-License-Identifier: Apache-2.0
// The rasterisers and the sum over slots. Contracts: RasterForward, RasterBackward and SumSlots in
// host/device/stages.hpp. KernelConfig::raster makes no difference here.
#pragma once

#include "cuda_backend/cuda_device.hpp"
#include "host/device/stages.hpp"

namespace ubs::cuda {

class Raster {
 public:
  Raster(CudaDevice& device, const KernelConfig& config)
      : device_(device), config_(config), kernels_(raster_kernels(config.depth)) {}

  void forward(const RasterForward& work);
  void backward(const RasterBackward& work);
  void sum_slots(const SumSlots& work);

 private:
  CudaDevice& device_;
  KernelConfig config_;
  RasterKernels kernels_;
};

}  // namespace ubs::cuda
