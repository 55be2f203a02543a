// SPDX-License-Identifier: Apache-2.0
// Whether a device computes what the method says: small made-up scenes on the kernels of one form, each stage
// on exact inputs and all of them together, against the float64 oracle of host/oracle; lists word for
// word; and the same bits a second time.
#pragma once

#include "host/check/expected.hpp"
#include "host/check/finding.hpp"

namespace ubs::check {

// One finding a stage, in the order of an iteration. Throws what the device throws: Error(build) where the
// kernels do not build, Error(memory), Error(device).
Findings examine(Device& device, const Subject& subject, const Expected& expected);
inline Findings examine(Device& device, const Subject& subject) {
  return examine(device, subject, expect(subject.config));
}

// The first that does not hold; null where all do.
const Finding* failure(const Findings& findings);

}  // namespace ubs::check
