// SPDX-License-Identifier: Apache-2.0
// measure() measures the time of an operation that is repeated on a device.
#pragma once

#include <functional>
#include <optional>

#include "host/base/statistics.hpp"
#include "host/device/device.hpp"

namespace ubs::bench {

struct Repeated {
  std::function<void()> run, prepare;  // `prepare` runs before each sample and is not timed; may be empty
};

struct Measured {
  Summary wall_ms;  // from the call until the device is idle
  // Mean time of the kernels by the device's own clock. For whole training iterations, it also includes
  // copies.
  std::optional<double> device_ms;
  double cpu_ms = 0;  // mean processor time of the whole process
};

// Runs the operation `calls` times, waits until the device is idle, and returns the wall time per call. Adds
// the processor time per call to `*processor_ms` unless it is null.
double timed_ms(Device& device, const Repeated& operation, int calls, double* processor_ms = nullptr);

// Measures the operation repeatedly until enough samples are taken or the time limit is reached (see
// `limits`). The first two calls are not counted.
Measured measure(Device& device, const Repeated& operation, const SamplingLimits& limits);

}  // namespace ubs::bench
