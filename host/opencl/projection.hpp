// SPDX-License-Identifier: Apache-2.0
// Conditioning + projection, forward and backward (kernels/map/project.cl).
#pragma once

#include "host/opencl/kernel_set.hpp"

namespace ubs::opencl {

class Projection {
 public:
  Projection(OpenclDevice& device, const KernelConfig& config);
  void forward(const ProjectForward& args);
  void backward(const ProjectBackward& args);

 private:
  Range items(std::uint32_t count) const;

  unsigned width_;  // lanes of a work-item
  bool backward_;
  KernelSet kernels_;
};

}  // namespace ubs::opencl
