// SPDX-License-Identifier: Apache-2.0
// A plan of a run for people and machines, and beside what the run then took.
#pragma once

#include <string>

#include "host/train/plan.hpp"
#include "tools/common/output.hpp"

namespace ubs::tools {

// Of a run, in the words of a plan; 0: unknown. The rest is a plan's alone.
struct RunFigures {
  double seconds = 0, step_ms = 0, mean_intersections = 0;
  std::uint64_t most_intersections = 0, memory_bytes = 0;
  PlanInterval times = {}, intersections = {}, memory = {};
  std::vector<double> curve = {};  // seconds after each percent of the iterations
  std::string fit = {};            // whether the memory at the end is there
};
RunFigures figures_of(const RunPlan& plan, const DeviceInfo& device);  // of its end
Json figures_json(const RunFigures& figures);                          // null without any
// "48 s (34 s to 1 min 10 s), 4.10 ms a step on average; memory 61.2 MiB (58.0 to 80.3): fits"
std::string figures_text(const RunFigures& planned);
// Actual, planned and what is between them, a line a quantity.
std::string comparison_text(const RunFigures& planned, const RunFigures& actual);

Json plan_json(const RunPlan& plan, const DeviceInfo& device);
std::string plan_text(const RunPlan& plan, const DeviceInfo& device);

}  // namespace ubs::tools
