// SPDX-License-Identifier: Apache-2.0
// KnownLimit describes a situation in which the formulas of kernels/math have a larger error than promised.
// Each limit names a property of the model by which rounding is amplified. The error of a gradient may then
// reach a stated multiple of (half an ulp) * (this amplification). The stated multiple is at most twice the
// largest multiple that was observed. There are no known limits for images. A run counts the cases by limit,
// and fails if one becomes worse.
#pragma once

#include <string>
#include <vector>

#include "host/lab/oracle/study.hpp"

namespace ubs::stress {

struct Verdict;

struct KnownLimit {
  std::string name;
  double (*amplification)(const oracle::Study&);
  double factor;  // largest allowed gradient error in units of 2^-24 * amplification
  // If 2^-24 * amplification is at least this, no digit of the gradient is promised, only that all values are
  // finite.
  double lost;
};

const std::vector<KnownLimit>& known_limits();
// Returns r = 2^-24 * amplification.
double limit_rounding(const KnownLimit& limit, const oracle::Study& study);

// Returns the limit that explains the errors of the case, or null if they are larger than all limits together
// allow.
const KnownLimit* known_limit(const oracle::Study& study, const Verdict& verdict);

}  // namespace ubs::stress
