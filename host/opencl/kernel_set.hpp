// SPDX-License-Identifier: Apache-2.0
// KernelSet contains the kernels of one program. Each kernel is created at its first launch, so that the
// driver only compiles kernels that are used.
#pragma once

#include <array>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

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

// MapKernels launches kernels of kernels/map in one-dimensional groups. `lanes` is the value of UBS_VW in the
// program, which is the number of elements per work-item.
class MapKernels {
 public:
  MapKernels(OpenclDevice& device, unsigned lanes, ProgramSpec spec)
      : lanes_(lanes), kernels_(device, std::move(spec)) {}
  MapKernels(OpenclDevice& device, unsigned lanes, std::vector<std::string> sources)
      : MapKernels(device, lanes, ProgramSpec{std::move(sources), {"-DUBS_VW=" + std::to_string(lanes)}}) {}

  template <typename Signature, typename... Args>
  void launch(Declared<Signature> kernel, std::size_t elements, std::size_t rows, const Args&... args) {
    if (elements == 0) return;
    kernels_[kernel]({round_up((elements + lanes_ - 1) / lanes_, kFlatGroup), rows}, {kFlatGroup}, args...);
  }
  template <typename Signature, typename... Args>
  void launch_each(Declared<Signature> kernel, std::size_t items, std::size_t rows, const Args&... args) {
    launch(kernel, items * lanes_, rows, args...);
  }
  unsigned lanes() const { return lanes_; }

 private:
  unsigned lanes_;
  KernelSet kernels_;
};

}  // namespace ubs::opencl
