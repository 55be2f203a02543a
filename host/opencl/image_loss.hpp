// SPDX-License-Identifier: Apache-2.0
// Stage ImageLoss on OpenCL: L1 + SSIM of an image against its target and the gradient, in two passes
// over tiles (kernels/gpu/loss.cl). Scratch: three float planes a channel in flight.
#pragma once

#include "host/opencl/core_groups.hpp"
#include "host/opencl/kernel_set.hpp"

namespace ubs::opencl {

class ImageLossKernels {
 public:
  ImageLossKernels(OpenclDevice& device, const KernelConfig& config);
  void run(const ImageLoss& loss);

 private:
  struct Maps {  // planes of ssim_point with zero margins
    std::uint32_t pitch = 0, plane = 0;
  };
  std::size_t channels(const ImageShape& shape) const;  // of a launch
  Range tiles(const ImageShape& shape) const;
  Maps prepare(const ImageShape& shape, bool gradient);
  void run_channels(const ImageLoss& loss, int first_channel, const Maps& maps);

  OpenclDevice& device_;
  unsigned width_;  // lanes of a work-item
  std::size_t tile_x_, group_;
  KernelSet& kernels(const ImageLoss& loss);

  CoreGroups core_groups_;
  KernelSet whole_, masked_;  // built when the first image comes, and the first mask
  ImageShape shape_;          // for which the margins of maps_ are zero
  Buffer<float> maps_, tile_sums_;
};

}  // namespace ubs::opencl
