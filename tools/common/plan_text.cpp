// SPDX-License-Identifier: Apache-2.0
#include "tools/common/plan_text.hpp"

#include <algorithm>

#include "host/base/memory_limit.hpp"
#include "host/train/expected_time.hpp"

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
      "{:<10} {:>10} splats {:>12.0f} intersections a view, {} at most {:>10.2f} ms a {} ({})\n", when,
      point.splats, point.mean_intersections, point.most_intersections, point.step_ms, what,
      point.measured ? "measured" : "scaled");
}

// "61.2 MiB (58.0 to 80.3)"; what is known has no interval.
std::string with_interval(double value, const PlanInterval& interval, int decimals, const char* unit = "") {
  const std::string text = fmt::format("{:.{}f}{}", value, decimals, unit);
  if (interval.least == interval.most) return text;
  return fmt::format("{} ({:.{}f} to {:.{}f})", text, interval.least * value, decimals, interval.most * value,
                     decimals);
}

Json interval_json(double value, const PlanInterval& interval) {
  return {interval.least * value, interval.most * value};
}

PlanInterval memory_interval(const RunPlan& plan) {
  const auto bytes = static_cast<double>(plan.memory.total());
  return {static_cast<double>(plan.memory_least.total()) / bytes,
          static_cast<double>(plan.memory_most.total()) / bytes};
}

std::string stages_text(const RunPlan& plan) {
  std::string text = fmt::format("\n{:<18} {:>9}  {}\n", "stage", "device ms", "kernels");
  for (const StageUse& use : plan.stages)
    text += fmt::format("{:<18} {:>9.3f}  {}\n", use.stage, use.device_ms, fmt::join(use.kernels, " "));
  if (plan.programs.empty()) return text + "kernels are compiled ahead of time\n";
  text += "\nprograms (sources; what they are specialised by; kernels)\n";
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
  text += fmt::format("total {} of {:.0f} MiB; largest '{}' {:.1f} of {:.0f} MiB in one piece{}: {}\n",
                      with_interval(mib(plan.memory.total()), memory_interval(plan), 1, " MiB"),
                      mib(device.memory_bytes), largest.label, mib(largest.bytes),
                      mib(device.max_allocation_bytes), memory_limits_text(), fit_text(plan, device));
  return text;
}

}  // namespace

RunFigures figures_of(const RunPlan& plan, const DeviceInfo& device) {
  const double steps = plan.iterations;
  return {.seconds = plan.seconds,
          .step_ms = plan.iterations > 0 ? 1e3 * plan.seconds / steps : plan.start.step_ms,
          .mean_intersections = plan.end.mean_intersections,
          .most_intersections = plan.end.most_intersections,
          .memory_bytes = plan.memory.total(),
          .times = kPlanInterval,
          .intersections = plan.intersections,
          .memory = memory_interval(plan),
          .curve = plan.curve,
          .fit = fit_text(plan, device)};
}

Json figures_json(const RunFigures& f) {
  if (f.seconds <= 0) return nullptr;
  Json json = {{"seconds", f.seconds},
               {"step_ms", f.step_ms},
               {"mean_intersections", f.mean_intersections},
               {"most_intersections", f.most_intersections},
               {"memory_bytes", f.memory_bytes}};
  const auto add = [&](const char* key, double value, const PlanInterval& interval) {
    if (interval.least < interval.most) json["intervals"][key] = interval_json(value, interval);
  };
  add("seconds", f.seconds, f.times);
  add("most_intersections", static_cast<double>(f.most_intersections), f.intersections);
  add("memory_bytes", static_cast<double>(f.memory_bytes), f.memory);
  return json;
}

std::string figures_text(const RunFigures& f) {
  return fmt::format("{}, {:.2f} ms a step on average; memory {}: {}",
                     interval_text(f.seconds, f.times.least, f.times.most), f.step_ms,
                     with_interval(mib(f.memory_bytes), f.memory, 1, " MiB"), f.fit);
}

std::string comparison_text(const RunFigures& planned, const RunFigures& actual) {
  std::string text;
  const auto add = [&](const char* what, double plan, double real, int decimals, const char* unit,
                       const PlanInterval& interval) {
    if (plan > 0 && real > 0)
      text += fmt::format("{:<9}{} {:.{}f}, planned {}\n", text.empty() ? "plan" : "", what, real, decimals,
                          with_interval(plan, interval, decimals, unit));
  };
  add("seconds", planned.seconds, actual.seconds, 1, "", planned.times);
  // Of a schedule that was fitted to a time, and has no memory, `times` is of all of it.
  add("step", planned.step_ms, actual.step_ms, 2, " ms",
      planned.memory_bytes > 0 ? planned.times : PlanInterval{});
  add("intersections of a view at most", static_cast<double>(planned.most_intersections),
      static_cast<double>(actual.most_intersections), 0, "", planned.intersections);
  add("memory", mib(planned.memory_bytes), mib(actual.memory_bytes), 1, " MiB", planned.memory);
  return text;
}

Json plan_json(const RunPlan& plan, const DeviceInfo& device) {
  Json levels = Json::array();
  for (const PlanLevel& l : plan.levels)
    levels.push_back({{"factor", l.level.factor},
                      {"until", l.level.until},
                      {"start_ms", l.start_ms},
                      {"end_ms", l.end_ms}});
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
          {"end_reached_at", plan.grown_at},
          {"views_measured", plan.views_measured},
          {"intersection_room", plan.intersection_room},
          {"correction",
           {{"intersections", plan.correction.intersections}, {"seconds", plan.correction.seconds}}},
          {"seconds", plan.seconds},
          {"seconds_interval", interval_json(plan.seconds, kPlanInterval)},
          {"most_intersections_interval",
           interval_json(static_cast<double>(plan.end.most_intersections), plan.intersections)},
          {"levels", levels},
          {"memory",
           {{"items", memory},
            {"total_bytes", plan.memory.total()},
            {"total_bytes_interval", {plan.memory_least.total(), plan.memory_most.total()}},
            {"fit", fit_text(plan, device)},
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
  if (plan.end.splats != plan.start.splats || plan.correction.intersections != 1)
    text += point_text("end", plan.end, what);
  if (training && plan.correction.intersections != 1)
    text += fmt::format(
        "           of it, {:.2f} times the intersections and {:.2f} times the time are what other scenes "
        "came to; {:.2g} to {:.2g} times these intersections are possible\n",
        plan.correction.intersections, plan.correction.seconds, plan.intersections.least,
        plan.intersections.most);
  if (plan.levels.size() > 1)
    for (const PlanLevel& l : plan.levels)
      text += fmt::format("to {:>7} {:>10} {:>6.2f} to {:.2f} ms a step\n", l.level.until,
                          l.level.factor > 1 ? fmt::format("1/{} size", l.level.factor) : "whole size",
                          l.start_ms, l.end_ms);
  text += fmt::format("intersections counted on the device in {} views\n", plan.views_measured);
  text += training ? fmt::format("expected: {} for {} iterations (docs/training.md says how good this is)\n",
                                 interval_text(plan.seconds, kPlanInterval.least, kPlanInterval.most),
                                 plan.iterations)
                   : fmt::format("expected: {:.2f} s for all views, {:.1f} a second\n", plan.seconds,
                                 1e3 / plan.start.step_ms);
  if (!plan.note.empty()) text += plan.note + "\n";
  return text + stages_text(plan) + memory_text(plan, device);
}

}  // namespace ubs::tools
