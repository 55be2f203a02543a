// SPDX-License-Identifier: Apache-2.0
// ImageLossKernels runs the stage ImageLoss on OpenCL devices. It computes the L1 + SSIM loss of an image
// against its target, and the gradient of the loss, in two passes over tiles (kernels/gpu/loss.cl). If the
// gradient is requested, it allocates three float planes as scratch memory for each channel of a launch.
#pragma once

#include "host/opencl/core_groups.hpp"
#include "host/opencl/kernel_set.hpp"

namespace ubs::opencl {

class ImageLossKernels {
 public:
  ImageLossKernels(OpenclDevice& device, const KernelConfig& config);
  void run(const ImageLoss& loss);

 private:
  struct Maps {  // layout of the planes with the results of ssim_point(); each plane has a margin of zeros
    std::uint32_t pitch = 0, plane = 0;
  };
  std::size_t channels(const ImageShape& shape) const;  // number of channels per launch
  Range tiles(const ImageShape& shape) const;
  Maps prepare(const ImageLoss& loss);
  void run_channels(const ImageLoss& loss, int first_channel, const Maps& maps);

  OpenclDevice& device_;
  unsigned width_;  // lanes per work-item
  std::size_t tile_x_, group_;
  KernelSet& kernels(const ImageLoss& loss);

  CoreGroups core_groups_;
  KernelSet whole_, masked_;  // without and with a mask; each is built at its first use
  ImageShape shape_;          // the shape for which the margins of maps_ are zero
  Buffer<float> maps_, tile_sums_;
};

}  // namespace ubs::opencl
