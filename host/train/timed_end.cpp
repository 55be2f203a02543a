// SPDX-License-Identifier: Apache-2.0
#include "host/train/timed_end.hpp"

#include <algorithm>
#include <cmath>

#include "host/train/pyramid.hpp"
#include "host/train/timeline.hpp"

namespace ubs {
namespace {

constexpr double kTimedShare = 0.1;  // of the schedule, before its end
constexpr int kMinTimed = 5;
constexpr double kMinStretch = 0.1, kMaxStretch = 4;

}  // namespace

TimedEnd::TimedEnd(double seconds, const TrainSettings& settings, const Split& train)
    : seconds_(seconds), settings_(settings) {
  const Timeline time(settings);
  before_ = time.before_end();
  from_ = before_ - static_cast<int>(kTimedShare * time.length());
  // The first step on whole images waits for them.
  const std::vector<PyramidLevel> levels = pyramid_levels(settings, train);
  if (levels.size() > 1) from_ = std::max(from_, levels[levels.size() - 2].until + 1);
}

// Times are known at every log_every-th iteration.
bool TimedEnd::can_time(const TrainSettings& settings, const Split& train) {
  const TimedEnd end(0, settings, train);
  return end.before_ - end.from_ >= kMinTimed + 2 * settings.log_every;
}

std::optional<TrainSettings> TimedEnd::after(const StepReport& report) {
  if (report.iteration > before_) return {};
  // Between two losses the device may be behind.
  if (report.loss && report.iteration >= from_) {
    known_ = report.seconds;
    known_at_ = report.iteration;
    if (began_at_ == 0) {
      began_at_ = report.iteration;
      began_ = report.seconds;
    }
  }
  const int planned = settings_.iterations - before_;
  if (report.iteration < before_ || planned < 1 || known_at_ - began_at_ < kMinTimed) return {};
  const double each = (known_ - began_) / (known_at_ - began_at_);
  const double left = (seconds_ - known_) / each - (before_ - known_at_);
  const double steps = std::clamp(left, kMinStretch * planned, kMaxStretch * planned);
  return ending_at(settings_, before_ + std::max(1, static_cast<int>(std::lround(steps))));
}

}  // namespace ubs
