// SPDX-License-Identifier: Apache-2.0
// Where the formulas of kernels/math lose more than the promise. Each limit names a number of the model by
// which rounding is amplified; the error of a gradient may be a stated multiple of (half an ulp) * (that
// number), at most twice what was observed. Images have no known limits. A run counts the cases by limit and
// fails where one gets worse.
#pragma once

#include <string>
#include <vector>

#include "host/lab/oracle/study.hpp"

namespace ubs::stress {

struct Verdict;

struct KnownLimit {
  std::string name;
  double (*amplification)(const oracle::Study&);
  double factor;  // largest gradient error in units of 2^-24 * amplification
  // From this 2^-24 * amplification on no digit of the gradient is promised: only that all is finite.
  double lost;
};

const std::vector<KnownLimit>& known_limits();
double limit_rounding(const KnownLimit& limit, const oracle::Study& study);  // r = 2^-24 * amplification

// The limit that explains the errors of the case, null where they are larger than all limits together allow.
const KnownLimit* known_limit(const oracle::Study& study, const Verdict& verdict);

}  // namespace ubs::stress
