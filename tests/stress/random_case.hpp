// SPDX-License-Identifier: Apache-2.0
// The cases of a randomised campaign: a function of (seed, number) alone.
#pragma once

#include "tests/stress/case.hpp"

namespace ubs::stress {

// Ordinary splats, most with one or two of their properties driven to an extreme: raw betas in [-12, 12],
// scales 1e-7 to 1e4, Sigma_q of condition up to 1e12, |omega| to 10, positions at the near plane, beside the
// frustum, around the camera and 1e7 from the origin, thresholds met, poisoned values (NaN, infinities,
// denormals, -0, FLT_MAX). Images from 1x1 to 8191x1, N from 3 to 7.
Case random_case(std::uint64_t seed, std::uint64_t number);

}  // namespace ubs::stress
