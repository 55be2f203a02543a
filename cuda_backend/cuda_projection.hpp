// SPDX-License-Identifier: Apache-2.0
// Projection runs the kernels that project splats: the forward pass, the backward pass to the parameters of
// the splats, and the backward pass to the camera. The first two have one thread per splat. The number of
// threads of the third one is CameraBackward::lanes.
#pragma once

#include "cuda_backend/cuda_device.hpp"
#include "host/device/stages.hpp"

namespace ubs::cuda {

// Returns the number of threads per block of the projection kernels and of the kernels that change the
// parameters of splats.
unsigned map_block(const CudaDevice& device);

class Projection {
 public:
  Projection(CudaDevice& device, const KernelConfig& config);

  void run(const ProjectForward& args);
  void run(const ProjectBackward& args);
  void run(const CameraBackward& args);

 private:
  dim3 items(u32 count) const;

  CudaDevice& device_;
  KernelConfig config_;
  std::size_t rows_;  // number of parameter rows
  ProjectKernels project_;
  CameraKernels camera_;  // set at the first use
  unsigned block_;        // threads per block
};

}  // namespace ubs::cuda
