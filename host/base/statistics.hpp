// SPDX-License-Identifier: Apache-2.0
// Sampler decides how long to repeat a measurement, and Summary describes the result. Times on shared
// machines have long upper tails: the median and the quartiles describe them, and the minimum shows what the
// machine can do.
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
  // Returns the standard error of the median, divided by the median. It is that of normal noise with this
  // quartile spread: 1.2533 sigma / sqrt(n) with sigma = spread / 1.349.
  double uncertainty() const;
};

// Computes quartiles by linear interpolation between order statistics. Without samples all results are zero.
Summary summarise(std::span<const double> samples);

struct SamplingLimits {
  double uncertainty = 0.01;  // stop when the median is known with this relative uncertainty
  double min_seconds = 0.3;   // but not before this time and number of samples
  double max_seconds = 2.0;   // stop after this time in any case, if there is a sample
  std::size_t min_samples = 5;
};

class Sampler {
 public:
  explicit Sampler(const SamplingLimits& limits) : limits_(limits) {}
  void add(double value) { values_.push_back(value); }
  bool enough() const;  // whether there are enough samples, or enough time has passed since construction
  Summary summary() const { return summarise(values_); }

 private:
  SamplingLimits limits_;
  Stopwatch watch_;
  std::vector<double> values_;
};

}  // namespace ubs
