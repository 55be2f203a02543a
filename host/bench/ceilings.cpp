// SPDX-License-Identifier: Apache-2.0
#include "host/bench/ceilings.hpp"

#include "host/device/registry.hpp"

namespace ubs::bench {

CeilingRates measure_ceilings(Device& device, bool quick) {
  CeilingLimits limits;
  if (quick) limits = {.large_bytes = std::size_t{8} << 20, .repetitions = 1};
  return ubs::measure_ceilings(device, limits);
}

Bound bound_of(const Cost& cost, const CeilingRates& ceilings, bool issue) {
  Bound bound;
  const auto consider = [&](double giga, double rate, const char* name) {
    if (!(giga > 0 && rate > 0)) return;
    const double ms = giga / rate * 1e3;
    if (ms > bound.ms) bound = {ms, name};
  };
  consider(cost.flops * 1e-9, ceilings.fma, "fma");
  if (cost.bytes <= static_cast<double>(ceilings.private_cache_bytes))
    consider(cost.bytes * 1e-9, ceilings.private_cache, "l2");
  else if (cost.bytes <= static_cast<double>(ceilings.shared_cache_bytes))
    consider(cost.bytes * 1e-9, ceilings.shared_cache, "cache");
  else
    consider(cost.bytes * 1e-9, ceilings.update, "memory");
  if (issue) consider(cost.issue_lanes * 1e-9, issue_rate(ceilings), "issue");
  return bound;
}

}  // namespace ubs::bench
