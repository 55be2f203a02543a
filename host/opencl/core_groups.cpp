// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/core_groups.hpp"

#include <fmt/format.h>
#ifdef __x86_64__
#include <cpuid.h>
#endif

namespace ubs::opencl {
namespace {

constexpr std::size_t kClaimStride = 16;  // kClaimStride

#ifdef __x86_64__
// Virtual machines may be without the instruction.
bool knows_rdtscp() {
  unsigned a = 0, b = 0, c = 0, d = 0;
  return __get_cpuid(0x80000001, &a, &b, &c, &d) && (d >> 27 & 1) != 0;
}
#endif

}  // namespace

std::uint32_t cores_for_groups(const OpenclDevice& device) {
#ifdef __x86_64__
  const DeviceInfo& info = device.info();
  return device.on_pocl_cpu() && info.compute_units > 1 && knows_rdtscp() ? info.compute_units : 0;
#else
  (void)device;
  return 0;
#endif
}

ProgramSpec CoreGroups::program(ProgramSpec spec) const {
  if (cores_ == 0) return spec;
  spec.sources.insert(spec.sources.begin(), "opencl/core_groups.h");
  spec.options.push_back(fmt::format("-DUBS_CORES={}", cores_));
  return spec;
}

CoreGroups::Claims CoreGroups::next_claims() {
  for (Buffer<std::uint32_t>& claims : claims_) {
    if (claims) continue;
    claims = Buffer<std::uint32_t>(device_, "claims of cores", cores_ * kClaimStride);
    claims.zero();
  }
  const std::size_t now = launches_ % 2;
  return {claims_[now].view(), claims_[1 - now].view()};
}

}  // namespace ubs::opencl
