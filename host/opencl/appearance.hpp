// SPDX-License-Identifier: Apache-2.0
// The part of stage ImageLoss that makes the colours of one photograph, and stage AppearanceStep, on OpenCL
// (kernels/map/appearance.cl, appearance_step.cl). Built and allocated when first asked for.
#pragma once

#include "host/opencl/kernel_set.hpp"

namespace ubs::opencl {

class AppearanceKernels {
 public:
  AppearanceKernels(OpenclDevice& device, const KernelConfig& config);
  BufferView<float> map(const ImageLoss& loss);  // the image of the photograph; valid until the next call
  void gradient(const ImageLoss& loss);  // v_image of the mapped image -> of the image, and of the numbers
  void step(const AppearanceStep& step);

 private:
  std::size_t vectors(std::size_t pixels) const {
    return round_up((pixels + width_ - 1) / width_, kFlatGroup);
  }

  OpenclDevice& device_;
  unsigned width_;  // lanes of a work-item
  KernelSet map_, step_;
  Buffer<float> mapped_, sums_;
};

}  // namespace ubs::opencl
