// SPDX-License-Identifier: Apache-2.0
#include "host/train/timeline.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace ubs {
namespace {

constexpr double kEnd = 0.15;  // share of the schedule that may be stretched

}  // namespace

Timeline::Timeline(const TrainSettings& s) : length_(s.iterations), end_(s.iterations) {
  const double stretch = s.lr_cooldown.stretch;
  if (stretch != 1)
    length_ = std::max(1, static_cast<int>(std::llround(s.iterations / (1 - kEnd + kEnd * stretch))));
  before_ = static_cast<int>(std::llround((1 - kEnd) * length_));
}

double Timeline::share(int iteration) const {
  if (iteration <= before_ || length_ == end_) return static_cast<double>(iteration) / length_;
  const double done = static_cast<double>(iteration - before_) / (end_ - before_);
  return (before_ + done * (length_ - before_)) / length_;
}

int Timeline::nearest(double scheduled) const {
  if (scheduled <= before_ || length_ == end_) return static_cast<int>(std::llround(scheduled));
  const double done = (scheduled - before_) / (length_ - before_);
  return before_ + std::max(1, static_cast<int>(std::llround(done * (end_ - before_))));
}

// Few digits, for people who read config.yaml, where they say the same.
TrainSettings ending_at(const TrainSettings& settings, int iterations) {
  const Timeline now(settings);
  TrainSettings s = settings;
  s.iterations = iterations;
  const double stretch = (static_cast<double>(iterations) / now.length() - (1 - kEnd)) / kEnd;
  for (int digits = 3; digits <= 17; ++digits) {
    s.lr_cooldown.stretch = std::stod(fmt::format("{:.{}g}", stretch, digits));
    if (Timeline(s).length() == now.length()) break;
  }
  return s;
}

}  // namespace ubs
