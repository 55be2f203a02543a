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

// The factors are at most twice the largest factors that were observed on PoCL (AVX-512) with the CPU
// rasteriser: 180 for the conic and 29 for the gradient, in 61 580 cases with seed 7, and 8.0 for colours, in
// 130 000 cases with an earlier version of the formulas.
const std::vector<KnownLimit>& known_limits() {
  static const std::vector<KnownLimit> kLimits{
      // The amplification is the magnitude of the terms of the determinant of the ellipse in the image,
      // divided by the determinant. It is large for needles, for discs that are seen from the side, and for
      // splats far from the optical axis.
      {"cancelling conic", [](const oracle::Study& s) { return s.amplification; }, 360, 2e-4},
      // The gradient is a sum of three parts: through the mean, through the ellipse, and through all other
      // values. The amplification is the sum of the magnitudes of these parts, divided by the magnitude of
      // the gradient. It is large for splats that cover the image although their centre is far outside.
      {"cancelling gradient", [](const oracle::Study& s) { return s.gradient_cancellation; }, 58, kInfinity},
      // The amplification is the largest magnitude of a colour divided by the smallest one.
      {"contrast of colours", [](const oracle::Study& s) { return s.colour_contrast; }, 16, 0.1},
      // If a query row contains only zeros and its scale is below 1e-30, the image is defined, but its
      // derivative is not.
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
