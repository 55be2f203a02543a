// SPDX-License-Identifier: Apache-2.0
// Work-groups by core (kernels/opencl/core_groups.h): for which devices, what their programs need, and how
// their kernels are launched.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "host/opencl/opencl_device.hpp"

namespace ubs::opencl {

constexpr std::size_t kCoreGroupItems = 16;  // UBS_CORE_GROUP_ITEMS

// Of PoCL on x86 CPUs of more than one core, whose kernels run in this process and can tell which core they
// run on; else 0.
std::uint32_t cores_for_groups(const OpenclDevice& device);

// UBS_CORE_SHARES: the share of each core, "0,0,1" for shares 0 and 1 of the cores 0 and 2. cores: those that
// the process may use, in ascending order. Empty where the remainders of their numbers by `shares` are
// different already.
std::string core_shares(std::span<const std::uint32_t> cores, std::uint32_t shares);

// The kernels of a stage, which are launched in groups of one work-item. With 0 cores groups are left to the
// driver.
class CoreGroups {
 public:
  CoreGroups(OpenclDevice& device, std::uint32_t cores) : device_(device), cores_(cores) {}

  explicit operator bool() const { return cores_ > 0; }
  // The program of such kernels.
  ProgramSpec program(ProgramSpec spec) const;

  template <typename... Parameters, typename... Args>
  void launch(Launch<Parameters...> kernel, std::size_t groups, const Args&... args) {
    kernel.template check<Args...>();
    launch(kernel.kernel, groups, args...);
  }
  template <typename... Args>
  void launch(Kernel& kernel, std::size_t groups, const Args&... args) {
    if (cores_ == 0) return kernel(Range{groups}, Range{1}, args...);
    if (groups == 0) return;  // such a launch would not prepare the claims of the next one
    const Claims claims = next_claims();
    kernel(Range{groups}, Range{1}, args..., claims.now, claims.next);
    ++launches_;  // one that failed has prepared nothing for the next
  }

 private:
  struct Claims {
    BufferView<std::uint32_t> now, next;
  };
  Claims next_claims();

  OpenclDevice& device_;
  std::uint32_t cores_;
  Buffer<std::uint32_t> claims_[2];  // made for the first launch
  std::size_t launches_ = 0;
};

}  // namespace ubs::opencl
