// SPDX-License-Identifier: Apache-2.0
// Measures what an OpenCL device can do at most, with kernels that do nothing else.
#pragma once

#include <cstddef>

#include "host/device/device.hpp"

namespace ubs::opencl {

struct CeilingLimits {
  std::size_t large_bytes = std::size_t{256} << 20;  // far beyond the caches
  int repetitions = 7;                               // the best counts
};

// GFLOP/s and GB/s; see ubs::bench::Ceilings for their meaning.
struct CeilingRates {
  double fma = 0, read = 0, write = 0, update = 0;  // streams through large_bytes
  double private_cache = 0, shared_cache = 0;       // 0: none known
  std::size_t private_cache_bytes = 0, shared_cache_bytes = 0;
};

// Throws Error(internal) when the device is no OpenCL device.
CeilingRates measure_ceilings(Device& device, const CeilingLimits& limits);

}  // namespace ubs::opencl
