// SPDX-License-Identifier: Apache-2.0
// ImageLossKernels runs the stage ImageLoss, which computes the L1 + SSIM loss of an image against its
// target, and the gradient of this loss. It makes one pass over the tiles of all channels for the loss, and a
// second one for the gradient. For the gradient, it allocates nine float planes as scratch memory.
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
  // Layout of the nine planes that hold the results of ssim_point(). Each plane has margins of zeros.
  struct Maps {
    int pitch = 0, plane = 0;  // numbers of floats per row and per plane
  };
  Maps prepare(const ImageShape& shape);

  CudaDevice& device_;
  LossKernels plain_, masked_;
  ImageShape shape_;  // the shape for which the margins of maps_ are zero
  Buffer<float> maps_, tile_sums_;
};

}  // namespace ubs::cuda
