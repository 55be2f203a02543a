// SPDX-License-Identifier: Apache-2.0
// Computes matrix products in float32 with cuBLAS (cublas.cpp). cuBLAS is opened when the first Gemm is
// created, because nothing else needs it, and it is larger than all other libraries together.
#pragma once

#include <memory>

#include "cuda_backend/cuda_device.hpp"
#include "host/device/metric_ops.hpp"

namespace ubs::cuda {

class Gemm {
 public:
  virtual ~Gemm() = default;
  // Enqueues the product C = A B on the stream of the device.
  virtual cudaError_t operator()(const MatrixProduct& product) = 0;
};

// If there is no cuBLAS, throws Error(device) with a message that says what to install.
std::unique_ptr<Gemm> make_gemm(CudaDevice& device);

}  // namespace ubs::cuda
