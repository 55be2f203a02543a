// SPDX-License-Identifier: Apache-2.0
// Projection, forward and backward, and backward to the camera: one thread a splat.
#pragma once

#include "cuda_backend/cuda_device.hpp"
#include "host/device/stages.hpp"

namespace ubs::cuda {

// Threads of a block of the kernels with one thread a splat.
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
  std::size_t rows_;  // of parameters
  ProjectKernels project_;
  CameraKernels camera_;  // with their first use
  unsigned block_;        // threads
};

}  // namespace ubs::cuda
