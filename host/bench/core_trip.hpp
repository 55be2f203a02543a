// SPDX-License-Identifier: Apache-2.0
// How far apart the cores of this process are. Virtual machines move theirs between caches, by the minute;
// what cores hand to one another then costs several times as much.
#pragma once

#include "host/base/time_source.hpp"

namespace ubs::bench {

// Time of a cache line from one core to another and back [ns], of the first core and that which is farthest
// from it: some 50 with a last-level cache in common, hundreds without. 0 with one core alone. A pair of
// cores that is busy with something else is given up after 10 ms of `time`.
double core_round_trip_ns(const TimeSource& time = steady_time());

}  // namespace ubs::bench
