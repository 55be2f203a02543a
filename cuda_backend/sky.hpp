// SPDX-License-Identifier: Apache-2.0
// Stages DrawSky, SkyGradient and SkyStep.
#pragma once

#include "cuda_backend/cuda_device.hpp"
#include "host/device/stages.hpp"

namespace ubs::cuda {

class Sky {
 public:
  explicit Sky(CudaDevice& device) : device_(device), kernels_(sky_kernels()) {}
  void draw(const DrawSky& a);
  void gradient(const SkyGradient& a);
  void step(const SkyStep& a);

 private:
  CudaDevice& device_;
  SkyTable kernels_;
  Buffer<float> sums_;
};

}  // namespace ubs::cuda
