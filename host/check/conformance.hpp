// SPDX-License-Identifier: Apache-2.0
// examine() checks whether a device computes correct results. It runs the kernels of one variant on a small
// synthetic scene: first each stage separately on exact inputs, then all stages together. The results are
// compared with float64 results that are embedded in the program (vectors.hpp). Tile lists must be equal to
// the expected ones, and a second run must give bit-identical results.
#pragma once

#include "host/check/finding.hpp"
#include "host/check/subject.hpp"

namespace ubs::check {

// Runs the checks of the parts in subject.parts, and returns one finding per check, in the order in which the
// checks run. The kernels are configured with checked_config(subject.config). Throws Error(build) if the
// kernels cannot be compiled, Error(memory) if the device has too little memory, and Error(device) if the
// driver fails.
Findings examine(Device& device, const Subject& subject);

// Returns the first finding whose error exceeds its bound, or null if there is none.
const Finding* failure(const Findings& findings);

}  // namespace ubs::check
