// SPDX-License-Identifier: Apache-2.0
// Counts splats that are practically equal to another one (docs/results/2026-12-01-copies.md). Such a pair
// shows what one splat could show.
#pragma once

#include "host/scene/mixed_model.hpp"

namespace ubs {

// Returns the share (0 to 1) of the live splats (opacity above 0.005) that have a double: another live splat
// of the same group whose position differs by less than 3 % of the geometric mean of the three scales, whose
// scales differ by less than 10 %, colours by less than 0.05, query means by less than 10 % of the width in
// the query, and raw betas by less than 0.2. Of models with more than 200 000 splats, an evenly spaced sample
// is compared with all splats. Returns 0 if no splat is alive.
double share_of_doubles(const MixedModel& model);

}  // namespace ubs
