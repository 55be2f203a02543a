// SPDX-License-Identifier: Apache-2.0
// See known_limits.hpp.
#include "host/stress/known_limits.hpp"

#include <algorithm>

#include "host/stress/judge.hpp"

namespace ubs::stress {
namespace {

constexpr double kHalfUlp = 0x1p-24;

double allowed(double rounding, double factor, double lost) {
  if (rounding == 0) return 0;
  return rounding >= lost ? kInfinity : factor * rounding;
}

}  // namespace

// Factors are at most twice the largest observed in 61 580 cases (seed 7) on PoCL (AVX-512), rasteriser cpu:
// 180; 29; 8.0 (in 130 000 cases of an earlier form of the formulas).
const std::vector<KnownLimit>& known_limits() {
  static const std::vector<KnownLimit> kLimits{
      {"cancelling conic",
       "sizes of the terms of the ellipse on the image over its determinant: needles, discs seen from the "
       "side, splats far beside the axis",
       [](const oracle::Study& s) { return s.amplification; }, 0, 360, 2e-4, kInfinity},
      {"cancelling gradient",
       "sizes of the gradient's parts through the mean, the ellipse and the rest over the size of their sum: "
       "splats "
       "that cover the image from far outside",
       [](const oracle::Study& s) { return s.gradient_cancellation; }, 0, 58, kInfinity, kInfinity},
      {"contrast of colours", "largest colour over the smallest",
       [](const oracle::Study& s) { return s.colour_contrast; }, 0, 16, 0.1, kInfinity},
      {"lifted pivot",
       "a query row of zeros whose scale is below 1e-30: the value is defined, the slope is not",
       [](const oracle::Study& s) { return s.floored > 0 ? kInfinity : 0; }, 0, 0, 1, kInfinity},
  };
  return kLimits;
}

double limit_rounding(const KnownLimit& limit, const oracle::Study& study) {
  return kHalfUlp * limit.amplification(study);
}

// Effects add; the one that allows most names the case.
const KnownLimit* known_limit(const oracle::Study& study, const Verdict& v) {
  double value = std::max(kPromise, kConditioning * v.value_floor);
  double gradient = std::max(kPromise, kConditioning * v.gradient_floor);
  double largest = 0;
  const KnownLimit* name = nullptr;
  for (const KnownLimit& limit : known_limits()) {
    const double rounding = limit_rounding(limit, study);
    const double more_value = limit.value == 0 ? 0 : allowed(rounding, limit.value, limit.value_lost);
    const double more_gradient = allowed(rounding, limit.gradient, limit.gradient_lost);
    value += more_value, gradient += more_gradient;
    if (more_gradient > largest) largest = more_gradient, name = &limit;
  }
  return v.value_error <= value && v.gradient_error <= gradient ? name : nullptr;
}

}  // namespace ubs::stress
