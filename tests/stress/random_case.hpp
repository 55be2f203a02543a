// SPDX-License-Identifier: Apache-2.0
// random_case() creates the cases of the random test. A case depends only on (seed, number).
#pragma once

#include "tests/stress/case.hpp"

namespace ubs::stress {

// Returns a case with ordinary splats. Most of them have one or two extreme properties: raw betas in [-12,
// 12], scales from 1e-7 to 1e4, Sigma_q with a condition number of up to 1e12, |omega| up to 10, positions at
// the near plane, beside the frustum, around the camera and 1e7 from the origin, thresholds that are met, or
// special values (NaN, infinities, denormals, -0, FLT_MAX). Image sizes are from 1x1 to 8191x1, and N from 3
// to 7.
Case random_case(std::uint64_t seed, std::uint64_t number);

}  // namespace ubs::stress
