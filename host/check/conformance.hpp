// SPDX-License-Identifier: Apache-2.0
// examine() checks whether a device computes correct results. It runs the kernels of one variant on a small
// synthetic scene: each stage alone on exact inputs, and all stages together. Results are compared with
// float64 results that are embedded in the program (vectors.hpp), tile lists are compared word for word, and
// a second run must be bit-identical.
#pragma once

#include "host/check/finding.hpp"
#include "host/check/subject.hpp"

namespace ubs::check {

// Returns one finding per stage, in the order of an iteration, for checked_config(subject.config). Throws the
// errors of the device: Error(build) if the kernels do not build, Error(memory), Error(device).
Findings examine(Device& device, const Subject& subject);

// Returns the first finding that does not hold, or null if all hold.
const Finding* failure(const Findings& findings);

}  // namespace ubs::check
