// SPDX-License-Identifier: Apache-2.0
#include "host/lab/bench/operation.hpp"

#include <algorithm>
#include <cmath>

#include "host/base/stopwatch.hpp"
#include "host/lab/bench/cpu_clock.hpp"

namespace ubs::bench {
namespace {

// Minimum duration of a sample. On PoCL, launching a kernel and waiting for it takes 30 to 60 us. Short
// stages are repeated within a sample, so that this overhead is only a small part of it.
constexpr double kSampleMs = 2;
constexpr int kMaxCalls = 32;

double device_ms(Device& device, const Repeated& operation, int calls) {
  device.set_profiling(true);
  for (int i = 0; i < calls; ++i) {
    if (operation.prepare) operation.prepare();
    operation.run();
  }
  double total = 0;
  for (const TimerEntry& entry : device.timings())
    if (entry.name != "copy") total += entry.device_ms;  // the copies were made by prepare()
  device.set_profiling(false);
  return total / calls;
}

}  // namespace

double timed_ms(Device& device, const Repeated& operation, int calls, double* processor_ms) {
  if (operation.prepare) operation.prepare();
  device.finish();
  const double processor = cpu_ms();
  const Stopwatch watch;
  for (int i = 0; i < calls; ++i) operation.run();
  device.finish();
  const double wall = watch.milliseconds() / calls;
  if (processor_ms) *processor_ms += (cpu_ms() - processor) / calls;
  return wall;
}

Measured measure(Device& device, const Repeated& operation, const SamplingLimits& limits) {
  timed_ms(device, operation, 1);  // warm-up: compiles, allocates, fills caches
  const double once = timed_ms(device, operation, 1);
  const int calls =
      operation.prepare
          ? 1
          : std::clamp(static_cast<int>(std::ceil(kSampleMs / std::max(once, 1e-3))), 1, kMaxCalls);
  Sampler sampler(limits);
  double processor = 0;
  while (!sampler.enough()) sampler.add(timed_ms(device, operation, calls, &processor));
  Measured measured{sampler.summary(), device_ms(device, operation, std::max(3, std::min(calls, 10)))};
  measured.cpu_ms = processor / static_cast<double>(measured.wall_ms.samples);
  return measured;
}

}  // namespace ubs::bench
