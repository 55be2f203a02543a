// SPDX-License-Identifier: Apache-2.0
// TimeSource tells how much time has passed. Code that decides something by the time takes a TimeSource, so
// that tests can replace the clock of the machine by a simulated one and do not depend on its speed.
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
