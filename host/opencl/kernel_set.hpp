// SPDX-License-Identifier: Apache-2.0
// The kernels of one program, each created at its first launch: a driver compiles only what runs.
#pragma once

#include <array>
#include <functional>
#include <map>
#include <string>
#include <utility>

#include "host/opencl/kernel.hpp"
#include "host/opencl/kernels.hpp"
#include "host/opencl/opencl_device.hpp"

namespace ubs::opencl {

class KernelSet {
 public:
  KernelSet(OpenclDevice& device, ProgramSpec spec)
      : device_(&device), spec_(device.tuned(std::move(spec))) {}

  template <typename... Parameters>
  Launch<Parameters...> operator[](Declared<void(Parameters...)> declared) {
    auto found = kernels_.find(declared.name);
    if (found == kernels_.end()) {
      found = kernels_.emplace(declared.name, device_->kernel(spec_, declared.name)).first;
      if (device_->synchronous()) found->second.check_types(std::array{parameter_type<Parameters>()...});
    }
    return {found->second};
  }

 private:
  OpenclDevice* device_;
  ProgramSpec spec_;
  std::map<std::string, Kernel, std::less<>> kernels_;
};

}  // namespace ubs::opencl
