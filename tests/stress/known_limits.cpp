// SPDX-License-Identifier: Apache-2.0
// See known_limits.hpp.
#include "tests/stress/known_limits.hpp"

#include <algorithm>

#include "tests/stress/judge.hpp"

namespace ubs::stress {
namespace {

constexpr double kHalfUlp = 0x1p-24;

double allowed(double rounding, const KnownLimit& limit) {
  return rounding == 0 ? 0 : rounding >= limit.lost ? kInfinity : limit.factor * rounding;
}

}  // namespace

// Factors are at most twice the largest observed in 61 580 cases (seed 7) on PoCL (AVX-512), rasteriser cpu:
// 180; 29; 8.0 (in 130 000 cases of an earlier form of the formulas).
const std::vector<KnownLimit>& known_limits() {
  static const std::vector<KnownLimit> kLimits{
      // Sizes of the terms of the ellipse on the image over its determinant: needles, discs seen from the
      // side, splats
      // far beside the axis.
      {"cancelling conic", [](const oracle::Study& s) { return s.amplification; }, 360, 2e-4},
      // Sizes of the gradient's parts through the mean, the ellipse and the rest over the size of their sum:
      // splats that
      // cover the image from far outside.
      {"cancelling gradient", [](const oracle::Study& s) { return s.gradient_cancellation; }, 58, kInfinity},
      // Largest colour over the smallest.
      {"contrast of colours", [](const oracle::Study& s) { return s.colour_contrast; }, 16, 0.1},
      // A query row of zeros whose scale is below 1e-30: the value is defined, the slope is not.
      {"lifted pivot", [](const oracle::Study& s) { return s.floored > 0 ? kInfinity : 0; }, 0, 1},
  };
  return kLimits;
}

double limit_rounding(const KnownLimit& limit, const oracle::Study& study) {
  return kHalfUlp * limit.amplification(study);
}

// Effects add; the one that allows most names the case.
const KnownLimit* known_limit(const oracle::Study& study, const Verdict& v) {
  if (!(v.value_error <= std::max(kPromise, kConditioning * v.value_floor))) return nullptr;
  double gradient = std::max(kPromise, kConditioning * v.gradient_floor), largest = 0;
  const KnownLimit* name = nullptr;
  for (const KnownLimit& limit : known_limits()) {
    const double more = allowed(limit_rounding(limit, study), limit);
    gradient += more;
    if (more > largest) largest = more, name = &limit;
  }
  return v.gradient_error <= gradient ? name : nullptr;
}

}  // namespace ubs::stress
