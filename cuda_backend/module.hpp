// SPDX-License-Identifier: Apache-2.0
// Module is a program that was compiled at run time and is loaded on the current device. Its kernels can be
// launched.
#pragma once

#include <cuda_runtime.h>

#include <string>

#include "cuda_backend/cuda_kernels.hpp"

namespace ubs::cuda {

class Module {
 public:
  // Throws Error(device) if the program cannot be loaded.
  explicit Module(const std::string& binary);
  ~Module();
  Module(const Module&) = delete;
  Module& operator=(const Module&) = delete;

  // Makes `kernel` refer to the kernel called `name`, which must have the parameters of `Signature`.
  template <typename Signature>
  void bind(Kernel<Signature>& kernel, const char* name) const {
    kernel.function = function(name);
  }

 private:
  void* function(const char* name) const;
  void* handle_ = nullptr;
};

// Launches a kernel of a Module. `arguments` are the addresses of the values, as for cudaLaunchKernel.
cudaError_t launch_function(void* function, dim3 grid, dim3 block, void** arguments, cudaStream_t stream);

}  // namespace ubs::cuda
