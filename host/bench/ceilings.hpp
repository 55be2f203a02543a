// SPDX-License-Identifier: Apache-2.0
// The limits that a stage's time is compared with, measured on the device in the same run.
#pragma once

#include <string>

#include "host/bench/cost_model.hpp"
#include "host/device/ceilings.hpp"

namespace ubs::bench {

// `quick`: small and rough, for tests.
CeilingRates measure_ceilings(Device& device, bool quick);

// Lane-instructions a second [G/s]: vector units that start an FMA of two operations a lane each cycle start
// any other vector instruction at that rate too. An estimate: loads, masks and branches share the ports.
inline double issue_rate(const CeilingRates& ceilings) { return ceilings.fma / 2; }

struct Bound {
  double ms = 0;   // no implementation of the stage can be faster
  std::string by;  // "fma", "memory", "cache", "l2", "issue"; empty where the cost is unknown
};
// The hardest of the limits. Bytes count against the smallest cache that holds them all. Issue counts only
// for CPU rasterisers, whose instructions the cost model knows.
Bound bound_of(const Cost& cost, const CeilingRates& ceilings, bool issue);

}  // namespace ubs::bench
