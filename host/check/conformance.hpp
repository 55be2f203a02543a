// SPDX-License-Identifier: Apache-2.0
// Whether a device computes what the method says: a small made-up scene on the kernels of one form, each
// stage on exact inputs and all of them together, against float64 results that are embedded (vectors.hpp);
// lists word for word; and the same bits a second time.
#pragma once

#include "host/check/finding.hpp"
#include "host/check/subject.hpp"

namespace ubs::check {

// One finding a stage, in the order of an iteration, for checked_config(subject.config). Throws what the
// device throws: Error(build) where the kernels do not build, Error(memory), Error(device).
Findings examine(Device& device, const Subject& subject);

// The first that does not hold; null where all do.
const Finding* failure(const Findings& findings);

}  // namespace ubs::check
