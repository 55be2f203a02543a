// SPDX-License-Identifier: Apache-2.0
// random_case() creates the cases of the stress test "random cases". A case depends only on its seed and its
// number.
#pragma once

#include "tests/stress/case.hpp"

namespace ubs::stress {

// Returns a case with random splats. Most of them have one or two of these extreme properties:
// - raw betas from -12 to 12;
// - scales from 1e-7 to 1e4, and needles;
// - a query covariance with a condition number of up to 1e12;
// - a query mean at a distance of up to 1e4 from the query;
// - rotation parameters of up to 10;
// - colours of up to 1e6;
// - positions at the near plane, beside the frustum or around the camera;
// - values that are exactly at a threshold, for example of the opacity;
// - NaN, infinities, denormals, -0 or FLT_MAX.
// Images have 1x1 to 8191x1 pixels, cameras are up to 1e7 from the origin, and N is 3 to 7.
Case random_case(std::uint64_t seed, std::uint64_t number);

}  // namespace ubs::stress
