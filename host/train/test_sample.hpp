// SPDX-License-Identifier: Apache-2.0
// TestSample decides when a few of the test views are measured during training, so that the quality curve of
// the run has values between the start and the end. Measurements take place after 20, 40, 60 and 80 % of the
// work. A measurement is skipped if all measurements together would take more than 2 % of the training time
// so far. Only the measurements depend on the clock; the model does not.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

namespace ubs {

struct SampledPsnr {
  double psnr = 0;        // mean of ViewMetrics::psnr_channel_mean over the sample [dB]
  std::size_t views = 0;  // size of the sample
};

class TestSample {
 public:
  // `views` is the number of test views. `limited` is true if the run has a time budget. In this case, all
  // measurements together also take at most 2 seconds.
  TestSample(std::size_t views, bool limited) : all_(views), limited_(limited) {}

  // Returns whether the sample must be measured now. `share` is the share of the work that is done, and
  // `seconds` is the training time so far. `guess` is an estimate of the seconds for one view, which is used
  // before the first measurement.
  bool is_due(double share, double seconds, double guess);
  // Measures the sample and records how long this took. Must only be called after is_due() has returned true.
  // The first call chooses the sample. `measure` returns the PSNR of a test view, and `now` returns the time
  // in seconds.
  SampledPsnr measure(const std::function<double(std::uint32_t view)>& measure,
                      const std::function<double()>& now);
  // Returns the indices of the views of the sample, which are evenly spaced. The sample is empty before the
  // first measurement.
  const std::vector<std::uint32_t>& views() const { return views_; }

 private:
  std::size_t all_;
  bool limited_;
  std::size_t next_ = 0;                  // index of the next share at which to measure
  double allowed_ = 0, spent_ = 0;        // seconds
  std::optional<double> seconds_a_view_;  // time per view in the last measurement
  std::vector<std::uint32_t> views_;
};

}  // namespace ubs
