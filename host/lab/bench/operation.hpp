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
  // Mean time by the device's own clock. It includes the kernels, and for iterations also the copies.
  std::optional<double> device_ms;
  double cpu_ms = 0;  // mean processor time of the whole process
};

// Runs the operation `calls` times until the device is idle, and returns the wall time per call. Adds the
// processor time per call to `processor_ms`.
double timed_ms(Device& device, const Repeated& operation, int calls, double* processor_ms = nullptr);

// Repeats the operation until the limits are met. The first two calls are not counted.
Measured measure(Device& device, const Repeated& operation, const SamplingLimits& limits);

}  // namespace ubs::bench
