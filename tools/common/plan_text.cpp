// SPDX-License-Identifier: Apache-2.0
#include "tools/common/plan_text.hpp"

#include <algorithm>

#include "host/base/memory_limit.hpp"
#include "host/base/text.hpp"

namespace ubs::tools {
namespace {

Json point_json(const PlanPoint& point) {
  return {{"splats", point.splats},
          {"mean_intersections", point.mean_intersections},
          {"most_intersections", point.most_intersections},
          {"step_ms", point.step_ms},
          {"measured", point.measured}};
}

std::string point_text(const char* when, const PlanPoint& point, const char* what) {
  return fmt::format(
      "{:<10} {:>10} splats {:>12.0f} intersections per view, {} at most {:>10.2f} ms per {} ({})\n", when,
      point.splats, point.mean_intersections, point.most_intersections, point.step_ms, what,
      point.measured ? "measured" : "scaled");
}

std::string stages_text(const RunPlan& plan) {
  std::string text = fmt::format("\n{:<18} {:>9}  {}\n", "stage", "device ms", "kernels");
  for (const StageUse& use : plan.stages)
    text += fmt::format("{:<18} {:>9.3f}  {}\n", use.stage, use.device_ms, fmt::join(use.kernels, " "));
  if (plan.programs.empty()) return text + "kernels are compiled ahead of time\n";
  text += "\nprograms (sources; options; kernels)\n";
  for (const ProgramUse& use : plan.programs)
    text += fmt::format("{}\n    {}\n    {}\n", use.sources, use.options, fmt::join(use.kernels, " "));
  return text;
}

std::string memory_text(const RunPlan& plan, const DeviceInfo& device) {
  std::string text = fmt::format("\n{:<62} {:>12} {:>12}\n", "memory at the end", "bytes each", "MiB");
  for (const MemoryItem& item : plan.memory.items)
    text += fmt::format(
        "{:<62} {:>12} {:>12.2f}\n", item.label,
        item.unit == MemoryUnit::fixed ? "" : fmt::format("{:.0f}/{}", item.each, to_string(item.unit)),
        mib(item.bytes));
  const MemoryItem& largest = plan.memory.largest();
  text += fmt::format("total {:.1f} MiB of {:.0f} MiB; largest buffer '{}' {:.1f} of {:.0f} MiB{}: {}\n",
                      mib(plan.memory.total()), mib(device.memory_bytes), largest.label, mib(largest.bytes),
                      mib(device.max_allocation_bytes), memory_limits_text(), memory_fit_text(plan, device));
  return text;
}

}  // namespace

Json plan_json(const RunPlan& plan, const DeviceInfo& device) {
  Json levels = Json::array();
  for (const PlanLevel& l : plan.levels)
    levels.push_back(
        {{"factor", l.factor}, {"until", l.until}, {"start_ms", l.start_ms}, {"end_ms", l.end_ms}});
  Json memory = Json::array(), stages = Json::array(), programs = Json::array();
  for (const MemoryItem& item : plan.memory.items)
    memory.push_back(
        {{"label", item.label}, {"unit", to_string(item.unit)}, {"each", item.each}, {"bytes", item.bytes}});
  for (const StageUse& use : plan.stages)
    stages.push_back({{"stage", use.stage}, {"device_ms", use.device_ms}, {"kernels", use.kernels}});
  for (const ProgramUse& use : plan.programs)
    programs.push_back({{"sources", use.sources}, {"options", use.options}, {"kernels", use.kernels}});
  return {{"iterations", plan.iterations},
          {"start", point_json(plan.start)},
          {"end", point_json(plan.end)},
          {"views_measured", plan.views_measured},
          {"intersection_room", plan.intersection_room},
          {"step_ms", plan.step_ms},
          {"seconds", plan.seconds},
          {"levels", levels},
          {"memory",
           {{"items", memory},
            {"total_bytes", plan.memory.total()},
            {"fit", memory_fit_text(plan, device)},
            {"largest_bytes", plan.memory.largest().bytes},
            {"device_bytes", device.memory_bytes},
            {"device_largest_bytes", device.max_allocation_bytes}}},
          {"stages", stages},
          {"programs", programs},
          {"note", plan.note}};
}

std::string plan_text(const RunPlan& plan, const DeviceInfo& device) {
  const bool training = plan.iterations > 0;
  const char* what = training ? "step" : "view";
  std::string text = point_text(training ? "start" : "model", plan.start, what);
  if (plan.end.splats != plan.start.splats) text += point_text("end", plan.end, what);
  if (plan.levels.size() > 1)
    for (const PlanLevel& l : plan.levels)
      text +=
          fmt::format("to {:>7} {:>10} {:>6.2f} to {:.2f} ms per step\n", l.until,
                      l.factor > 1 ? fmt::format("1/{} size", l.factor) : "full size", l.start_ms, l.end_ms);
  text += fmt::format("intersections counted on the device in {} views\n", plan.views_measured);
  text += training ? fmt::format("{} iterations at the measured {:.2f} ms per step: {}\n", plan.iterations,
                                 plan.step_ms, duration_text(plan.seconds))
                   : fmt::format("all views at the measured {:.2f} ms per view: {}\n", plan.start.step_ms,
                                 duration_text(plan.seconds));
  if (!plan.note.empty()) text += plan.note + "\n";
  return text + stages_text(plan) + memory_text(plan, device);
}

}  // namespace ubs::tools
