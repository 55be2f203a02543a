// SPDX-License-Identifier: Apache-2.0
// Stages PlaceDrawn, PickDrawn, UnpackDrawn and SpreadGradient on OpenCL (kernels/map/drawn.cl).
#pragma once

#include "host/opencl/kernel_set.hpp"
#include "host/opencl/scan.hpp"

namespace ubs::opencl {

class DrawnKernels {
 public:
  DrawnKernels(OpenclDevice& device, const KernelConfig& config);
  std::uint32_t place(const PlaceDrawn& a);
  void pick(const PickDrawn& a);
  void unpack(const UnpackDrawn& a);
  void spread(const SpreadGradient& a);

 private:
  OpenclDevice& device_;
  KernelSet kernels_;
  Scan scan_;
};

}  // namespace ubs::opencl
