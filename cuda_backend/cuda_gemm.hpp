// SPDX-License-Identifier: Apache-2.0
// Matrix products in float32 through cuBLAS (cublas.cpp). The library is looked for when the first product is
// wanted: nothing else needs it, and it is larger than all of the rest.
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

// Throws Error(device) saying what to install when there is no cuBLAS.
std::unique_ptr<Gemm> make_gemm(CudaDevice& device);

}  // namespace ubs::cuda
