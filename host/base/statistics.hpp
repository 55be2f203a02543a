// SPDX-License-Identifier: Apache-2.0
// How long to repeat a measurement and what to say about it. Times on shared machines have long upper tails:
// the median and the quartiles describe them, the minimum is what the machine can do.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "host/base/stopwatch.hpp"

namespace ubs {

struct Summary {
  std::size_t samples = 0;
  double median = 0, minimum = 0, lower_quartile = 0, upper_quartile = 0;

  double quartile_spread() const { return upper_quartile - lower_quartile; }
  // Standard error of the median over the median, as for normal noise of this quartile spread:
  // 1.2533 sigma / sqrt(n) with sigma = spread / 1.349.
  double uncertainty() const;
};

// Quartiles by linear interpolation between order statistics. No samples: all zero.
Summary summarise(std::span<const double> samples);

struct SamplingLimits {
  double uncertainty = 0.01;  // enough when the median is known to this
  double min_seconds = 0.3;   // but not before this time and these samples
  double max_seconds = 2.0;   // enough in any case, when there is one sample
  std::size_t min_samples = 5;
};

class Sampler {
 public:
  explicit Sampler(const SamplingLimits& limits) : limits_(limits) {}
  void add(double value) { values_.push_back(value); }
  bool enough() const;  // of samples, or of the time since construction
  Summary summary() const { return summarise(values_); }

 private:
  SamplingLimits limits_;
  Stopwatch watch_;
  std::vector<double> values_;
};

}  // namespace ubs
