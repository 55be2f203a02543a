// SPDX-License-Identifier: Apache-2.0
// for_each_stages() runs a test of single stages with the CPU and the GPU kernels on every device. uploaded()
// creates a buffer with given values.
#pragma once

#include <algorithm>
#include <catch2/catch.hpp>
#include <vector>

#include "tests/support/device_fixture.hpp"

namespace ubs::test {

// Calls f(device, stages) for every device and both kinds of kernels. The CPU kernels, which use vectors, are
// skipped on devices whose vector width is 1.
template <class F>
void for_each_stages(const F& f, KernelConfig config = {}) {
  for (const auto& device : devices_under_test())
    for (const RasterKind kind : {RasterKind::cpu, RasterKind::gpu}) {
      if (kind == RasterKind::cpu && device->info().float_vector_width == 1) continue;
      config.raster = kind;
      INFO(describe(device->info()) << (kind == RasterKind::cpu ? ", vectors" : ", work-items"));
      const auto stages = make_stages(*device, config);
      f(*device, *stages);
    }
}

template <typename T>
Buffer<T> uploaded(Device& device, const std::vector<T>& values) {
  Buffer<T> buffer(device, "test", std::max<std::size_t>(values.size(), 1));
  buffer.upload(values);
  return buffer;
}

}  // namespace ubs::test
