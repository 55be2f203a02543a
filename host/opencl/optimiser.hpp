// SPDX-License-Identifier: Apache-2.0
// Stages Regularise and AdamStep on OpenCL (kernels/map/regularise.cl, adam.cl).
#pragma once

#include "host/opencl/kernel_set.hpp"

namespace ubs::opencl {

// A program of kernels that change parameters, `width` splats a work-item.
ProgramSpec update_program(std::vector<std::string> sources, unsigned width, const KernelConfig& config);
// Adam, penalties and noise.
ProgramSpec step_program(unsigned width, const KernelConfig& config);

class Optimiser {
 public:
  Optimiser(OpenclDevice& device, const KernelConfig& config);
  void regularise(const Regularise& stage);
  void adam(const AdamStep& stage);

 private:
  Range items(std::uint32_t count, std::size_t rows) const;

  unsigned width_;                   // lanes of a work-item
  std::size_t rows_, trained_rows_;  // parameters of a splat, those that are learnt
  KernelSet kernels_;
};

}  // namespace ubs::opencl
