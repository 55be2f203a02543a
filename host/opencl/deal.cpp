// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/deal.hpp"

#include <fmt/format.h>

namespace ubs::opencl {
namespace {

constexpr std::size_t kClaimStride = 16, kDealGroup = 16;  // UBS_CLAIM_STRIDE, UBS_DEAL_GROUP

}  // namespace

bool deals_by_core(const OpenclDevice& device) {
#ifdef __x86_64__
  return device.is_pocl() && device.info().type == DeviceType::cpu && device.info().compute_units > 1;
#else
  (void)device;
  return false;
#endif
}

Range dealt_range(std::size_t items) { return {round_up(items, kDealGroup) / kDealGroup}; }

std::string deal_option(std::uint32_t cores) { return fmt::format("-DUBS_CORES={}", cores); }

Buffer<std::uint32_t> make_claims(OpenclDevice& device, std::uint32_t cores) {
  Buffer<std::uint32_t> claims(device, "claims of cores", (cores + std::size_t{1}) * kClaimStride);
  claims.zero();
  return claims;
}

}  // namespace ubs::opencl
