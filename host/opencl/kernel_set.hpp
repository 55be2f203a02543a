// SPDX-License-Identifier: Apache-2.0
// The kernels of one program, each created at its first launch: a driver compiles only what runs.
#pragma once

#include <map>
#include <string>
#include <utility>

#include "host/opencl/kernel.hpp"
#include "host/opencl/opencl_device.hpp"

namespace ubs::opencl {

class KernelSet {
 public:
  KernelSet(OpenclDevice& device, ProgramSpec spec)
      : device_(&device), spec_(device.tuned(std::move(spec))) {}

  Kernel& operator[](const std::string& name) {
    auto found = kernels_.find(name);
    if (found == kernels_.end()) found = kernels_.emplace(name, device_->kernel(spec_, name)).first;
    return found->second;
  }

 private:
  OpenclDevice* device_;
  ProgramSpec spec_;
  std::map<std::string, Kernel> kernels_;
};

}  // namespace ubs::opencl
