// SPDX-License-Identifier: Apache-2.0
// Times of something that a device is asked to do again and again.
#pragma once

#include <functional>
#include <optional>

#include "host/base/statistics.hpp"
#include "host/device/device.hpp"

namespace ubs::bench {

struct Repeated {
  std::function<void()> run, prepare;  // prepare is not timed; may be empty
};

struct Measured {
  Summary wall_ms;                  // from the call until the device is idle
  std::optional<double> device_ms;  // mean of the device's own clock: kernels, of iterations copies too
  double cpu_ms = 0;                // processor time of the whole process, mean
};

// Wall time a call of some calls, until the device is idle; adds the processor time a call to `processor_ms`.
double timed_ms(Device& device, const Repeated& operation, int calls, double* processor_ms = nullptr);

// Repeats until the limits are met; the first two calls do not count.
Measured measure(Device& device, const Repeated& operation, const SamplingLimits& limits);

}  // namespace ubs::bench
