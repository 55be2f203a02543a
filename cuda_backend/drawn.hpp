// SPDX-License-Identifier: Apache-2.0
// Stages PlaceDrawn, PickDrawn, UnpackDrawn and SpreadGradient.
#pragma once

#include "cuda_backend/cuda_device.hpp"
#include "host/device/stages.hpp"

namespace ubs::cuda {

class Drawn {
 public:
  explicit Drawn(CudaDevice& device) : device_(device), kernels_(drawn_kernels()) {}
  u32 place(const PlaceDrawn& a);
  void pick(const PickDrawn& a);
  void unpack(const UnpackDrawn& a);
  void spread(const SpreadGradient& a);

 private:
  CudaDevice& device_;
  DrawnTable kernels_;
  Buffer<u32> marks_;
};

}  // namespace ubs::cuda
