// SPDX-License-Identifier: Apache-2.0
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

// Factors are at most twice the largest values that were observed in 61 580 cases (seed 7) on PoCL (AVX-512)
// with rasteriser cpu: 180; 29; 8.0 (the last one in 130 000 cases of an earlier version of the formulas).
const std::vector<KnownLimit>& known_limits() {
  static const std::vector<KnownLimit> kLimits{
      // Magnitude of the terms of the ellipse in the image / its determinant. It is large for needles, discs
      // that are seen from the side, and splats far from the axis.
      {"cancelling conic", [](const oracle::Study& s) { return s.amplification; }, 360, 2e-4},
      // Magnitude of the parts of the gradient through the mean, the ellipse and the rest / magnitude of
      // their sum. It is large for splats that cover the image from far outside.
      {"cancelling gradient", [](const oracle::Study& s) { return s.gradient_cancellation; }, 58, kInfinity},
      // Largest colour / smallest colour.
      {"contrast of colours", [](const oracle::Study& s) { return s.colour_contrast; }, 16, 0.1},
      // For a query row of zeros whose scale is below 1e-30, the value is defined, but the slope is not.
      {"lifted pivot", [](const oracle::Study& s) { return s.floored > 0 ? kInfinity : 0; }, 0, 1},
  };
  return kLimits;
}

double limit_rounding(const KnownLimit& limit, const oracle::Study& study) {
  return kHalfUlp * limit.amplification(study);
}

// The allowed errors of all limits are added. The case gets the name of the limit that allows the largest
// error.
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
