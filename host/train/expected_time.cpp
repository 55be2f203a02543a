// SPDX-License-Identifier: Apache-2.0
#include "host/train/expected_time.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace ubs {

std::string duration_text(double seconds) {
  if (seconds < 9.95) return fmt::format("{:.1f} s", seconds);
  const long long s = std::llround(seconds), m = std::llround(seconds / 60);
  if (s < 60) return fmt::format("{} s", s);
  if (s < 600) return fmt::format("{} min {} s", s / 60, s % 60);
  if (m < 60) return fmt::format("{} min", m);
  return fmt::format("{} h {} min", m / 60, m % 60);
}

double remaining_seconds(const std::vector<double>& curve, double share, double slowness) {
  if (curve.size() < 2) return 0;
  const double at = std::clamp(share, 0.0, 1.0) * static_cast<double>(curve.size() - 1);
  const auto left = std::min(static_cast<std::size_t>(at), curve.size() - 2);
  const double done = curve[left] + (curve[left + 1] - curve[left]) * (at - static_cast<double>(left));
  return slowness * (curve.back() - done);
}

std::string interval_text(double seconds, double least, double most) {
  return fmt::format("{} ({} to {})", duration_text(seconds), duration_text(least * seconds),
                     duration_text(most * seconds));
}

}  // namespace ubs
