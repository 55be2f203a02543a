// SPDX-License-Identifier: Apache-2.0
// A program that was compiled at run time, loaded on the current device, and the launch of its kernels.
#pragma once

#include <cuda_runtime.h>

#include <string>

#include "cuda_backend/cuda_kernels.hpp"

namespace ubs::cuda {

class Module {
 public:
  // Throws Error(device).
  explicit Module(const std::string& binary);
  ~Module();
  Module(const Module&) = delete;
  Module& operator=(const Module&) = delete;

  // The kernel must have the parameters that `kernel` says.
  template <typename Signature>
  void bind(Kernel<Signature>& kernel, const char* name) const {
    kernel.function = function(name);
  }

 private:
  void* function(const char* name) const;
  void* handle_ = nullptr;
};

// arguments: addresses of the values, as for cudaLaunchKernel.
cudaError_t launch_function(void* function, dim3 grid, dim3 block, void** arguments, cudaStream_t stream);

}  // namespace ubs::cuda
