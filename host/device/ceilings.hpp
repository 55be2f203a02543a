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

// GFLOP/s and GB/s.
struct CeilingRates {
  double fma = 0;              // independent chains of multiply-adds on registers
  double read = 0, write = 0;  // streams through large_bytes, one direction
  double update = 0;           // read and written in place, both counted
  double private_cache = 0;    // read again and again from the caches of the cores
  double shared_cache = 0;     // updates within half of the cache that the device reports; 0: no larger one
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
