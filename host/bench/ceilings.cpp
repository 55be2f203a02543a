// SPDX-License-Identifier: Apache-2.0
#include "host/bench/ceilings.hpp"

#include "host/device/registry.hpp"

namespace ubs::bench {

Ceilings measure_ceilings(Device& device, bool quick) {
  CeilingLimits limits;
  if (quick) limits = {.large_bytes = std::size_t{8} << 20, .repetitions = 1};
  const CeilingRates r = ubs::measure_ceilings(device, limits);
  return {r.fma,           r.read,
          r.write,         r.update,
          r.private_cache, static_cast<double>(r.private_cache_bytes),
          r.shared_cache,  static_cast<double>(r.shared_cache_bytes)};
}

Bound bound_of(const Cost& cost, const Ceilings& ceilings, bool issue) {
  Bound bound;
  const auto consider = [&](double giga, double rate, const char* name) {
    if (!(giga > 0 && rate > 0)) return;
    const double ms = giga / rate * 1e3;
    if (ms > bound.ms) bound = {ms, name};
  };
  consider(cost.flops * 1e-9, ceilings.fma_gflops, "fma");
  if (cost.bytes <= ceilings.private_cache_bytes)
    consider(cost.bytes * 1e-9, ceilings.private_cache_gbs, "l2");
  else if (cost.bytes <= ceilings.shared_cache_bytes)
    consider(cost.bytes * 1e-9, ceilings.shared_cache_gbs, "cache");
  else
    consider(cost.bytes * 1e-9, ceilings.update_gbs, "memory");
  if (issue) consider(cost.issue_lanes * 1e-9, ceilings.issue_rate(), "issue");
  return bound;
}

}  // namespace ubs::bench
