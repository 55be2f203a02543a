// SPDX-License-Identifier: Apache-2.0
#include "host/accuracy/front.hpp"

#include <algorithm>
#include <cmath>

namespace ubs::accuracy {
namespace {

bool dominates(const Point& a, const Point& b) {
  const double slack = std::max(kTimeTolerance, 3 * std::hypot(a.uncertainty, b.uncertainty));
  const bool faster = a.time * (1 + slack) < b.time, slower = b.time * (1 + slack) < a.time;
  const bool better = a.error * (1 + kErrorTolerance) < b.error,
             worse = b.error * (1 + kErrorTolerance) < a.error;
  return !slower && !worse && (faster || better);
}

}  // namespace

std::vector<bool> pareto_front(std::span<const Point> points) {
  std::vector<bool> front;
  for (const Point& p : points)
    front.push_back(std::ranges::none_of(points, [&](const Point& other) { return dominates(other, p); }));
  return front;
}

}  // namespace ubs::accuracy
