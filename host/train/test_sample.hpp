// SPDX-License-Identifier: Apache-2.0
// TestSample decides when a few of the test views are measured during a training, so that its curve has some
// values between start and end. A measurement takes place after 20, 40, 60 and 80 % of the work, if the time
// for it is less than 2 % of the training time. Only the measurements depend on the clock, never the model.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

namespace ubs {

struct SampledPsnr {
  double psnr = 0;        // mean over the views of the sample [dB], as in Metrics
  std::size_t views = 0;  // size of the sample
};

class TestSample {
 public:
  // `views`: number of test views. `limited`: the run has a time budget; then all measurements together also
  // take at most 2 seconds.
  TestSample(std::size_t views, bool limited) : all_(views), limited_(limited) {}

  // Returns whether to measure at this share of the work, after this training time. `guess` is the estimated
  // time for one view, for the first measurement.
  bool is_due(double share, double seconds, double guess);
  // Measures the sample and notes how long it took; is_due() must have returned true. The first call chooses
  // the sample. `measure` returns the PSNR of a test view, `now` the time in seconds.
  SampledPsnr measure(const std::function<double(std::uint32_t view)>& measure,
                      const std::function<double()>& now);
  // Returns the indices of the evenly spaced views of the sample; empty before the first measurement.
  const std::vector<std::uint32_t>& views() const { return views_; }

 private:
  std::size_t all_;
  bool limited_;
  std::size_t next_ = 0;                  // index of the next share at which to measure
  double allowed_ = 0, spent_ = 0;        // seconds
  std::optional<double> seconds_a_view_;  // of the last measurement
  std::vector<std::uint32_t> views_;
};

}  // namespace ubs
