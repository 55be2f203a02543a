// SPDX-License-Identifier: Apache-2.0
// The Pareto front of error against time, with the tolerance that measurements need.
#pragma once

#include <span>
#include <vector>

namespace ubs::accuracy {

struct Point {
  double time = 0;         // ratio or ms
  double uncertainty = 0;  // relative, of the time: one standard error
  double error = 0;
};

inline constexpr double kTimeTolerance = 0.02, kErrorTolerance = 0.1;

// Whether each point is on the front: no other one is better in time or error by more than the tolerance and
// not worse in the other. Times count as equal within max(2 %, three standard errors of both), errors within
// 10 %: two orders of the same sums differ as much.
std::vector<bool> pareto_front(std::span<const Point> points);

}  // namespace ubs::accuracy
