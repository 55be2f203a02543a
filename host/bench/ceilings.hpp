// SPDX-License-Identifier: Apache-2.0
// The limits that a stage's time is compared with, measured on the device in the same run.
#pragma once

#include <string>

#include "host/bench/cost_model.hpp"
#include "host/device/device.hpp"

namespace ubs::bench {

struct Ceilings {
  double fma_gflops = 0;  // independent chains of multiply-adds on registers
  double read_gbs = 0;    // a stream of 256 MB, one direction
  double write_gbs = 0;
  double update_gbs = 0;         // read and written in place, both counted
  double private_cache_gbs = 0;  // read again and again from the caches of the cores
  double private_cache_bytes = 0;
  double shared_cache_gbs = 0;  // updates within half of the cache that the device reports; 0: no larger one
  double shared_cache_bytes = 0;
  // Lane-instructions a second [G/s]: vector units that start an FMA of two operations a lane each cycle
  // start any other vector instruction at that rate too. An estimate: loads, masks and branches share the
  // ports.
  double issue_rate() const { return fma_gflops / 2; }
};

// `quick`: small and rough, for tests.
Ceilings measure_ceilings(Device& device, bool quick);

struct Bound {
  double ms = 0;   // no implementation of the stage can be faster
  std::string by;  // "fma", "memory", "cache", "l2", "issue"; empty where the cost is unknown
};
// The hardest of the limits. Bytes count against the smallest cache that holds them all. Issue counts only
// for CPU rasterisers, whose instructions the cost model knows.
Bound bound_of(const Cost& cost, const Ceilings& ceilings, bool issue);

}  // namespace ubs::bench
