// SPDX-License-Identifier: Apache-2.0
// Matrix products in float32 with cuBLAS (cublas.cpp). The library is opened at the first product, because
// nothing else needs it, and it is larger than all other libraries together.
#pragma once

#include <memory>

#include "cuda_backend/cuda_device.hpp"
#include "host/device/metric_ops.hpp"

namespace ubs::cuda {

class Gemm {
 public:
  virtual ~Gemm() = default;
  // Enqueues C = A B on the stream of the device.
  virtual cudaError_t operator()(const MatrixProduct& product) = 0;
};

// Throws Error(device), saying what to install, if there is no cuBLAS.
std::unique_ptr<Gemm> make_gemm(CudaDevice& device);

}  // namespace ubs::cuda
