// SPDX-License-Identifier: Apache-2.0
// The part of stage ImageLoss that makes the colours of one photograph, and stage AppearanceStep.
#pragma once

#include "cuda_backend/cuda_device.hpp"
#include "host/device/stages.hpp"

namespace ubs::cuda {

class Appearance {
 public:
  explicit Appearance(CudaDevice& device) : device_(device), kernels_(appearance_kernels()) {}
  BufferView<float> map(const ImageLoss& loss);  // the image of the photograph; valid until the next call
  void gradient(const ImageLoss& loss);  // v_image of the mapped image -> of the image, and of the numbers
  void step(const AppearanceStep& step);

 private:
  CudaDevice& device_;
  AppearanceTable kernels_;
  Buffer<float> mapped_, sums_;
};

}  // namespace ubs::cuda
