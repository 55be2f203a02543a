// SPDX-License-Identifier: Apache-2.0
// ImageLossKernels runs the stage ImageLoss: the L1 + SSIM loss of an image against its target, and the
// gradient, in two passes over tiles of all channels. It allocates nine float planes as scratch memory.
#pragma once

#include "cuda_backend/cuda_device.hpp"
#include "host/device/stages.hpp"

namespace ubs::cuda {

class ImageLossKernels {
 public:
  explicit ImageLossKernels(CudaDevice& device)
      : device_(device), plain_(loss_kernels(false)), masked_(loss_kernels(true)) {}
  void run(const ImageLoss& loss);

 private:
  struct Maps {  // planes of ssim_point() with zero margins
    int pitch = 0, plane = 0;
  };
  Maps prepare(const ImageShape& shape);

  CudaDevice& device_;
  LossKernels plain_, masked_;
  ImageShape shape_;  // the shape for which the margins of maps_ are zero
  Buffer<float> maps_, tile_sums_;
};

}  // namespace ubs::cuda
