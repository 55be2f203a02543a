// SPDX-License-Identifier: Apache-2.0
// Stages DrawSky, SkyGradient and SkyStep on OpenCL (kernels/map/sky.cl, sky_step.cl). Built and allocated
// when first asked for.
#pragma once

#include "host/opencl/kernel_set.hpp"

namespace ubs::opencl {

class SkyKernels {
 public:
  SkyKernels(OpenclDevice& device, const KernelConfig& config);
  void draw(const DrawSky& a);
  void gradient(const SkyGradient& a);
  void step(const SkyStep& a);

 private:
  std::size_t vectors(int pitch) const {
    return round_up(static_cast<std::size_t>(pitch) / width_, kFlatGroup);
  }

  OpenclDevice& device_;
  unsigned width_;  // lanes of a work-item; divides the side of a tile
  KernelSet map_, step_;
  Buffer<float> sums_;
};

}  // namespace ubs::opencl
