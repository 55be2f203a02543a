// SPDX-License-Identifier: Apache-2.0
// A plan of a run for people and machines, and beside what the run then took.
#pragma once

#include <string>

#include "host/train/plan.hpp"
#include "tools/common/output.hpp"

namespace ubs::tools {

// Of a run, in the words of a plan; 0: unknown.
struct RunFigures {
  double seconds = 0, step_ms = 0, mean_intersections = 0;
  std::uint64_t most_intersections = 0, memory_bytes = 0;
  std::vector<double> curve = {};  // planned seconds after each percent of the iterations
  std::string misfit = {};         // why the memory at the end is too much for the device
};
RunFigures figures_of(const RunPlan& plan);    // of its end: memory and most intersections
Json figures_json(const RunFigures& figures);  // null without any
// "planned 12.3 s, 4.1 ms a step, ...; actual ..." in one line a quantity.
std::string comparison_text(const RunFigures& planned, const RunFigures& actual);

Json plan_json(const RunPlan& plan, const DeviceInfo& device);
std::string plan_text(const RunPlan& plan, const DeviceInfo& device);

}  // namespace ubs::tools
