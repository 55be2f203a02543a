// SPDX-License-Identifier: Apache-2.0
// Sampler decides how often to repeat a measurement, and Summary describes the results. On shared machines, a
// few of the measured times are much longer than the others. Therefore Summary contains the median and the
// quartiles instead of the mean, and the minimum, which is the time on an otherwise idle machine.
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
  // Returns the standard error of the median, divided by the median. It assumes that the noise is normal with
  // the standard deviation sigma = quartile_spread() / 1.349. Then the standard error is 1.2533 sigma /
  // sqrt(samples).
  double uncertainty() const;
};

// Summarises the samples. Quartiles are interpolated linearly between neighbouring samples. Without samples,
// all results are zero.
Summary summarise(std::span<const double> samples);

struct SamplingLimits {
  double uncertainty = 0.01;    // stop when Summary::uncertainty() is at most this
  double min_seconds = 0.3;     // do not stop before this time has passed
  double max_seconds = 2.0;     // stop after this time in any case, if there is a sample
  std::size_t min_samples = 5;  // do not stop with fewer samples before max_seconds have passed
};

class Sampler {
 public:
  explicit Sampler(const SamplingLimits& limits) : limits_(limits) {}
  void add(double value) { values_.push_back(value); }
  // Returns whether the measurement can stop. Time is measured since the construction of the sampler.
  bool enough() const;
  Summary summary() const { return summarise(values_); }

 private:
  SamplingLimits limits_;
  Stopwatch watch_;
  std::vector<double> values_;
};

}  // namespace ubs
