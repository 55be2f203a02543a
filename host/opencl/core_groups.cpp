// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/core_groups.hpp"

#include <fmt/format.h>
#include <sched.h>

#include <algorithm>
#include <set>
#include <vector>
#ifdef __x86_64__
#include <cpuid.h>
#endif

namespace ubs::opencl {
namespace {

constexpr std::size_t kClaimStride = 16;  // the same as kClaimStride in kernels/opencl/core_groups.h

#ifdef __x86_64__
// Returns whether the processor supports the instruction rdtscp. Some virtual machines do not.
bool knows_rdtscp() {
  unsigned a = 0, b = 0, c = 0, d = 0;
  return __get_cpuid(0x80000001, &a, &b, &c, &d) && (d >> 27 & 1) != 0;
}
#endif

// Returns the numbers of the cores that this process may use, or an empty list if they cannot be determined.
std::vector<std::uint32_t> usable_cores() {
  cpu_set_t set;
  std::vector<std::uint32_t> cores;
  if (sched_getaffinity(0, sizeof set, &set) != 0) return cores;  // there are too many cores for the set
  for (std::uint32_t core = 0; core < CPU_SETSIZE; ++core)
    if (CPU_ISSET(core, &set)) cores.push_back(core);
  return cores;
}

}  // namespace

std::string core_shares(std::span<const std::uint32_t> cores, std::uint32_t shares) {
  std::set<std::uint32_t> remainders;
  for (const std::uint32_t core : cores) remainders.insert(core % shares);
  if (cores.empty() || remainders.size() == std::min<std::size_t>(cores.size(), shares)) return "";
  std::vector<std::uint32_t> table(cores.back() + 1, 0);
  for (std::size_t rank = 0; rank < cores.size(); ++rank)
    table[cores[rank]] = static_cast<std::uint32_t>(rank % shares);
  return fmt::format("{}", fmt::join(table, ","));
}

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
  if (const std::string shares = core_shares(usable_cores(), cores_); !shares.empty())
    spec.options.push_back("-DUBS_CORE_SHARES=" + shares);
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
