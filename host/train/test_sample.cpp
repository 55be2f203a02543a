// SPDX-License-Identifier: Apache-2.0
#include "host/train/test_sample.hpp"

#include <algorithm>
#include <array>

namespace ubs {
namespace {

constexpr std::array kShares{0.2, 0.4, 0.6, 0.8};  // shares of the work after which the sample is measured
constexpr std::size_t kMostViews = 8;              // maximum number of views in the sample
// Maximum time of all measurements together: a share of the training time so far. For runs with a time
// budget, it is also at most kMostSeconds times the share of the work that is done.
constexpr double kTimeShare = 0.02, kMostSeconds = 2;
// The size of the sample is chosen so that the first measurement takes at most this part of the allowed time.
// Later measurements take longer, because there are more splats.
constexpr double kUsed = 0.5;

}  // namespace

bool TestSample::is_due(double share, double seconds, double guess) {
  if (all_ == 0 || next_ == kShares.size() || share < kShares[next_]) return false;
  while (next_ < kShares.size() && kShares[next_] <= share) ++next_;
  allowed_ = kTimeShare * seconds;
  if (limited_) allowed_ = std::min(allowed_, kMostSeconds * share);
  const double needed =
      seconds_a_view_.value_or(guess) * static_cast<double>(std::max<std::size_t>(1, views_.size()));
  return spent_ + needed <= allowed_;
}

SampledPsnr TestSample::measure(const std::function<double(std::uint32_t view)>& measure,
                                const std::function<double()>& now) {
  const double begin = now();
  double sum = 0;
  std::size_t measured = 0;
  if (views_.empty()) {  // the time of the first view determines the size of the sample
    sum = measure(0);
    measured = 1;
    const double each = now() - begin, left = kUsed * (allowed_ - spent_) - each;
    std::size_t count = std::min(kMostViews, all_);
    if (left < each * static_cast<double>(count - 1))
      count = 1 + static_cast<std::size_t>(std::max(0.0, left / each));
    for (std::size_t k = 0; k < count; ++k) views_.push_back(static_cast<std::uint32_t>(k * all_ / count));
  }
  for (; measured < views_.size(); ++measured) sum += measure(views_[measured]);
  const double took = now() - begin, count = static_cast<double>(views_.size());
  spent_ += took;
  seconds_a_view_ = took / count;
  return {sum / count, views_.size()};
}

}  // namespace ubs
