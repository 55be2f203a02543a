// SPDX-License-Identifier: Apache-2.0
// KnownLimit describes a situation in which the formulas of kernels/math have a larger error than kPromise
// (judge.hpp). Each limit has an amplification: a property of the model by which rounding errors are
// multiplied. The error of a gradient may then be up to factor * 2^-24 * amplification. The factor is at most
// twice the largest one that was observed. There are no known limits for images. A stress run counts the
// cases of each limit. It fails if the error of a case is larger than the limits allow together.
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
  // If 2^-24 * amplification is at least this value, the gradient may have any error, but must be finite.
  double lost;
};

// Returns all known limits.
const std::vector<KnownLimit>& known_limits();
// Returns 2^-24 * amplification.
double limit_rounding(const KnownLimit& limit, const oracle::Study& study);

// Returns the limit that explains the errors of the case, or null if they are larger than all limits together
// allow.
const KnownLimit* known_limit(const oracle::Study& study, const Verdict& verdict);

}  // namespace ubs::stress
