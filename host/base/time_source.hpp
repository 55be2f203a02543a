// SPDX-License-Identifier: Apache-2.0
// TimeSource measures time. Code whose decisions depend on time uses a TimeSource, so that tests can replace
// the clock of the machine by a simulated clock and do not depend on the speed of the machine.
#pragma once

namespace ubs {

class TimeSource {
 public:
  virtual ~TimeSource() = default;
  // Returns the seconds since a fixed but arbitrary moment. The value never decreases. It may jump forward,
  // for example while the process is stopped or the machine is suspended.
  virtual double seconds() const = 0;
};

// Returns the steady clock of this machine. The object lives as long as the program.
const TimeSource& steady_time();

}  // namespace ubs
