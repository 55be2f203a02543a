// SPDX-License-Identifier: Apache-2.0
// Measures what a device can do at most, with kernels that do nothing else (kernels/map/ceilings.cl): the
// same on all back ends, which only launch them.
#pragma once

#include <cstddef>
#include <cstdint>

#include "host/device/device.hpp"

namespace ubs {

struct CeilingLimits {
  std::size_t large_bytes = std::size_t{256} << 20;  // far beyond the caches
  int repetitions = 7;                               // the best counts
  std::uint32_t fma_rounds = 0;                      // 0: what takes long enough on the device
};

// GFLOP/s and GB/s; see ubs::bench::Ceilings for their meaning.
struct CeilingRates {
  double fma = 0, read = 0, write = 0, update = 0;  // streams through large_bytes
  double private_cache = 0, shared_cache = 0;       // 0: none known
  std::size_t private_cache_bytes = 0, shared_cache_bytes = 0;
};

// Work-items `items` in groups of `group`; item i takes `count` vectors from i * spacing on, `step` apart.
struct CeilingLaunch {
  std::size_t items = 1, group = 1;
  std::uint32_t spacing = 1, step = 1, count = 0, rounds = 1;
};
class CeilingKernels {
 public:
  virtual ~CeilingKernels() = default;
  virtual unsigned lanes() const = 0;            // UBS_VW
  virtual std::size_t shared_cache() const = 0;  // bytes that the device reports
  virtual void fma(const CeilingLaunch& launch, BufferView<float> out, float factor) = 0;
  virtual void read(const CeilingLaunch& launch, BufferView<float> in, BufferView<float> out) = 0;
  virtual void write(const CeilingLaunch& launch, BufferView<float> out, float value) = 0;
  virtual void update(const CeilingLaunch& launch, BufferView<float> inout, float value) = 0;
};

CeilingRates measure_ceilings(Device& device, CeilingKernels& kernels, const CeilingLimits& limits);

}  // namespace ubs
