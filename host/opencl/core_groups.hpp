// SPDX-License-Identifier: Apache-2.0
// CoreGroups launches kernels whose work-groups are assigned to CPU cores (kernels/opencl/core_groups.h).
// This header also declares functions that determine which devices support such kernels, and which options
// their programs need.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "host/opencl/opencl_device.hpp"

namespace ubs::opencl {

constexpr std::size_t kCoreGroupItems = 16;  // the default of UBS_CORE_GROUP_ITEMS in the kernels

// Returns the number of cores if the device supports such kernels, which is the case for PoCL on an x86 CPU
// with more than one core and the instruction rdtscp. The kernels of PoCL run in this process and can
// determine which core they run on. Returns 0 for all other devices.
std::uint32_t cores_for_groups(const OpenclDevice& device);

// Returns the value of UBS_CORE_SHARES, which contains the share of each core. For example, "0,0,1" means
// that core 0 has share 0 and core 2 has share 1. `cores` contains the numbers of the cores that the process
// may use, in ascending order. By default, the kernels divide the number of a core by `shares` and use the
// remainder as its share. Therefore the result is empty if these remainders already distribute the cores over
// all shares. It is also empty if `cores` is empty.
std::string core_shares(std::span<const std::uint32_t> cores, std::uint32_t shares);

// CoreGroups launches the kernels of a stage in groups of one work-item. If `cores` is 0, the driver
// distributes the groups.
class CoreGroups {
 public:
  CoreGroups(OpenclDevice& device, std::uint32_t cores) : device_(device), cores_(cores) {}

  explicit operator bool() const { return cores_ > 0; }
  // Returns `spec` with the sources and options that such kernels need.
  ProgramSpec program(ProgramSpec spec) const;

  template <typename... Parameters, typename... Args>
  void launch(Launch<Parameters...> kernel, std::size_t groups, const Args&... args) {
    kernel.template check<Args...>();
    launch(kernel.kernel, groups, args...);
  }
  template <typename... Args>
  void launch(Kernel& kernel, std::size_t groups, const Args&... args) {
    if (cores_ == 0) return kernel(Range{groups}, Range{1}, args...);
    if (groups == 0) return;  // an empty launch would not prepare the claims of the next one
    const Claims claims = next_claims();
    kernel(Range{groups}, Range{1}, args..., claims.now, claims.next);
    ++launches_;  // skipped if the launch throws, because then the next claims are not prepared
  }

 private:
  struct Claims {
    BufferView<std::uint32_t> now, next;
  };
  Claims next_claims();

  OpenclDevice& device_;
  std::uint32_t cores_;
  Buffer<std::uint32_t> claims_[2];  // created at the first launch
  std::size_t launches_ = 0;
};

}  // namespace ubs::opencl
