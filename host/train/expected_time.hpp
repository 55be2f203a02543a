// SPDX-License-Identifier: Apache-2.0
// Times for people, and what is left of a run whose plan says how its time is spread over the iterations.
#pragma once

#include <string>
#include <vector>

namespace ubs {

// "4.2 s", "48 s", "6 min 5 s", "35 min", "2 h 17 min".
std::string duration_text(double seconds);
// "48 s (36 s to 1 min 46 s)".
std::string interval_text(double seconds, double least, double most);

// What is left of a run of which `share` is done: `curve` has the expected seconds at equal steps from 0 to
// all of it, and steps take `slowness` times as long as it says.
double remaining_seconds(const std::vector<double>& curve, double share, double slowness);

}  // namespace ubs
