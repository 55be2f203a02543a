// SPDX-License-Identifier: Apache-2.0
#include "host/train/plan.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <map>
#include <span>

#include "host/base/error.hpp"
#include "host/base/stopwatch.hpp"
#include "host/device/operations.hpp"
#include "host/pipeline/device_groups.hpp"
#include "host/settings/schedule.hpp"
#include "host/train/kernel_warm_up.hpp"
#include "host/train/measure_steps.hpp"
#include "host/train/run_settings.hpp"

namespace ubs {
namespace {

constexpr double kViewSeconds = 1;                     // maximum time for counting intersections
constexpr std::size_t kMinViews = 8, kMaxViews = 256;  // limits of the number of counted views
constexpr std::size_t kEndViews = 3;  // number of views that are rendered at the final number of splats
// Maximum number of splats that are measured. Each splat takes about 420 bytes of host memory during the
// measurement.
constexpr std::uint32_t kMaxCopied = 4'000'000;

// StageLog records operations in the order of their execution, with the kernels that each of them launches. A
// model whose splats have several dimensions has stages and a StageRecorder for each group. All these
// recorders write to the same log.
class StageLog {
 public:
  explicit StageLog(Device& device) : device_(device) {}
  const std::vector<StageUse>& uses() const { return uses_; }

  template <typename Run>
  void note(const char* stage, const Run& run) {
    run();
    StageUse use{stage, {}, 0};
    std::map<std::string, TimerEntry> now;
    for (const TimerEntry& entry : device_.timings()) now[entry.name] = entry;
    for (const auto& [name, entry] : now) {
      const TimerEntry& before = seen_[name];
      if (entry.calls == before.calls) continue;
      use.device_ms += entry.device_ms - before.device_ms;
      if (name != "read" && name != "write" && name != "copy" && name != "fill") use.kernels.push_back(name);
    }
    seen_ = std::move(now);
    uses_.push_back(std::move(use));
  }

 private:
  Device& device_;
  std::map<std::string, TimerEntry> seen_;
  std::vector<StageUse> uses_;
};

// StageRecorder forwards operations to other stages and records them in a StageLog.
class StageRecorder final : public Stages {
 public:
  StageRecorder(StageLog& log, Stages& stages) : log_(log), stages_(stages) {}

  const KernelConfig& config() const override { return stages_.config(); }
  Outcome run(const Operation& operation) override {
    Outcome outcome;
    log_.note(kOperationNames[operation.index()], [&] { outcome = stages_.run(operation); });
    return outcome;
  }

 private:
  StageLog& log_;
  Stages& stages_;
};

// Renders views in the order of `views` and returns the number of intersections of each. Stops when
// kViewSeconds have passed and at least kMinViews are rendered, or after kMaxViews.
template <typename Splats>  // SplatView, or a span of RenderGroup
std::vector<std::uint64_t> count_views(Renderer& renderer, const Splats& splats,
                                       const RenderSettings& settings,
                                       const std::vector<std::uint32_t>& views) {
  std::vector<std::uint64_t> counts;
  const Stopwatch watch;
  for (const std::uint32_t view : views) {
    if (counts.size() >= kMaxViews || (counts.size() >= kMinViews && watch.seconds() > kViewSeconds)) break;
    counts.push_back(renderer.forward(splats, view, settings, false).intersections);
  }
  return counts;
}

void take_counts(PlanPoint& point, const std::vector<std::uint64_t>& counts) {
  for (const std::uint64_t count : counts) {
    point.mean_intersections += static_cast<double>(count) / static_cast<double>(counts.size());
    point.most_intersections = std::max(point.most_intersections, count);
  }
}

// Returns the capacity that a buffer with the capacity `room` has after a request. If a buffer grows, it
// grows by at least half of its capacity (Buffer::reserve).
std::uint64_t room_after(std::uint64_t room, std::uint64_t request) {
  return request <= room ? room : std::max(request, room + room / 2);
}

// Returns the capacity that the list buffers have at the end of the run. It simulates how the buffers grow,
// first with the measured views of the initial model, and then while the number of splats increases.
std::uint64_t room_at_end(const RunPlan& plan, const Schedule& schedule,
                          const std::vector<std::uint64_t>& first_views) {
  std::uint64_t room = 0;
  for (const std::uint64_t count : first_views) room = room_after(room, count);
  const double p0 = plan.start.splats, p1 = plan.end.splats;
  const auto i0 = static_cast<double>(plan.start.most_intersections),
             i1 = static_cast<double>(plan.end.most_intersections);
  for (int k = 1; k <= 100; ++k) {
    const double splats = schedule.splats_at(0.01 * k);
    room = room_after(room,
                      static_cast<std::uint64_t>(p1 > p0 ? i0 + (i1 - i0) * (splats - p0) / (p1 - p0) : i0));
  }
  return room;
}

// Executes every operation of training once and records the kernels that it launches.
std::vector<StageUse> record_stages(Device& device, const TrainSettings& settings, const Split& train,
                                    const SplatModel& initial) {
  KernelWarmUp warm_up(device, settings, train.views[0], initial);
  warm_up.learn(warm_up.stages());  // compiles the kernels and uploads the images
  device.set_profiling(true);
  StageLog log(device);
  StageRecorder recorder(log, warm_up.stages());
  warm_up.learn(recorder);
  device.set_profiling(false);
  return log.uses();
}

// Renders one view and records its operations: the projection of each group, then the lists and the
// rasteriser for all groups.
std::vector<StageUse> record_drawing(Device& device, const DeviceGroups& model, const Split& split,
                                     const RenderSettings& settings) {
  StageLog log(device);
  std::deque<StageRecorder> recorders;
  std::vector<RenderGroup> groups;
  for (std::size_t g = 0; g < model.groups().size(); ++g)
    groups.push_back({&recorders.emplace_back(log, model.stages(g)), model.view()[g].splats});
  device.set_profiling(true);
  Renderer renderer(device, recorders.front());
  renderer.set_cameras(cameras_of(split));
  renderer.forward(groups, 0, settings, false);
  device.set_profiling(false);
  return log.uses();
}

// Measures the intersections and the step times for the number of splats at the end of the run. The measured
// model consists of copies of the initial splats.
void measure_end(Trainer& trainer, const TrainSettings& measuring, const Split& train,
                 const SplatModel& initial, const std::vector<std::uint32_t>& views,
                 const std::vector<std::uint64_t>& first_views, RunPlan& plan) {
  const TrainState grown = first_state(trainer, copies(initial, plan.end.splats), measuring);
  trainer.restore(grown);  // the cameras are those of the last level, which has full-size images
  double before = 0, after = 0;
  for (std::size_t k = 0; k < std::min({kEndViews, views.size(), first_views.size()}); ++k) {
    before += static_cast<double>(first_views[k]);
    after += static_cast<double>(
        trainer.scene()
            .renderer()
            .forward(trainer.scene().device_model().view(), views[k], trainer.scene().render_settings(), true)
            .intersections);
  }
  const double ratio = before > 0 ? after / before : 1;
  plan.end.mean_intersections = ratio * plan.start.mean_intersections;
  plan.end.most_intersections =
      static_cast<std::uint64_t>(ratio * static_cast<double>(plan.start.most_intersections));
  const std::vector<double> times = step_times(trainer, train, grown);
  for (std::size_t k = 0; k < times.size(); ++k) plan.levels[k].end_ms = times[k];
  plan.end.step_ms = times.back();
  plan.end.measured = true;
}

// Extrapolates the measurements with the initial model to the final number of splats. This is used if a model
// with the final number of splats is too large to be measured.
void scale_end(RunPlan& plan) {
  const double ratio = static_cast<double>(plan.end.splats) / plan.start.splats;
  plan.end.mean_intersections = ratio * plan.start.mean_intersections;
  plan.end.most_intersections =
      static_cast<std::uint64_t>(ratio * static_cast<double>(plan.start.most_intersections));
  plan.end.step_ms = ratio * plan.start.step_ms;
  for (PlanLevel& level : plan.levels) level.end_ms = ratio * level.start_ms;
}

// Returns the mean time of a step over the whole run, in which the number of splats grows from the initial to
// the final number.
double mean_step_ms(const RunPlan& plan, const Schedule& schedule, const std::vector<PyramidLevel>& levels) {
  std::vector<StepCost> costs;
  const double start = plan.start.splats, end = plan.end.splats;
  for (const PlanLevel& level : plan.levels) {
    const double each = end > start ? (level.end_ms - level.start_ms) / (end - start) : 0;
    costs.push_back({level.factor, level.start_ms - each * start, each, 0});
  }
  return 1e3 * WorkTime(costs, schedule, levels).steps_left(0);
}

}  // namespace

std::string memory_fit_text(const RunPlan& plan, const DeviceInfo& device) {
  const std::string why = memory_shortage(plan.memory, device);
  return why.empty() ? "fits" : "does not fit: " + why;
}

RunPlan plan_training(Device& device, const Plan& training, const Split& train, const Split& test,
                      const SplatModel& initial) {
  const TrainSettings& settings = training.settings();
  const Schedule schedule(settings, initial.count);
  RunPlan plan;
  plan.iterations = settings.iterations;
  plan.start.splats = static_cast<std::uint32_t>(initial.count);
  plan.end.splats = schedule.splats_at(1.0);
  const std::size_t capacity = std::max(initial.count, static_cast<std::size_t>(settings.cap_max));
  MemoryQuestion question = memory_question(settings, train, test, device.info(), capacity);
  question.refinement = !settings.refine.empty();
  check_fits(plan_memory(question), device.info());
  plan.stages = record_stages(device, settings, train, initial);
  plan.programs = device.programs();

  ViewOrder order(settings.seed, static_cast<std::uint32_t>(train.views.size()));
  std::vector<std::uint32_t> views;
  for (std::uint64_t draw = 0; draw < train.views.size(); ++draw) views.push_back(order(draw));
  const std::vector<PyramidLevel> levels = pyramid_levels(settings, train);
  for (const PyramidLevel& level : levels)
    plan.levels.push_back(
        {level.factor, schedule.work().iteration_at(level.until * schedule.work().steps()), 0, 0});
  const Split none{"test", {}};
  const Plan measuring = measuring_plan(training, plan.end.splats);
  Trainer trainer(device, measuring, train, none, initial);
  const std::vector<std::uint64_t> counts =
      count_views(trainer.scene().renderer(), trainer.scene().device_model().view(),
                  trainer.scene().render_settings(), views);
  take_counts(plan.start, counts);
  plan.views_measured = counts.size();
  const std::vector<double> times = step_times(trainer, train, trainer.state());
  for (std::size_t k = 0; k < times.size(); ++k) plan.levels[k].start_ms = plan.levels[k].end_ms = times[k];
  plan.start.step_ms = times.back();
  plan.start.measured = true;
  if (plan.end.splats == plan.start.splats)
    plan.end = plan.start;
  else {
    try {
      if (plan.end.splats > kMaxCopied)
        fail(ErrorKind::memory, "the estimate supports at most {} splats", kMaxCopied);
      measure_end(trainer, measuring.settings(), train, initial, views, counts, plan);
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::memory) throw;
      scale_end(plan);
      plan.note = fmt::format("{} splats could not be measured: {}", plan.end.splats, error.what());
    }
  }
  plan.step_ms = mean_step_ms(plan, schedule, levels);
  plan.seconds = 1e-3 * plan.step_ms * plan.iterations;
  plan.intersection_room = room_at_end(plan, schedule, counts);
  question.intersections = plan.intersection_room;
  plan.memory = plan_memory(question);
  return plan;
}

RunPlan plan_rendering(Device& device, const TrainSettings& drawing, const Split& split,
                       const MixedModel& model, bool depth) {
  TrainSettings settings = drawing;
  settings.dim = model.dim();
  RunPlan plan;
  plan.start.splats = plan.end.splats = static_cast<std::uint32_t>(model.count());
  MemoryQuestion question = memory_question(settings, split, {"", {}}, device.info(), model.count());
  question.dim = model.dim();
  question.variant = model.variant();
  for (const SplatModel& group : model.groups) question.groups.push_back({group.dim, group.count});
  question.training = question.refinement = false;
  question.depth = depth;
  question.target_bytes = 0;
  check_fits(plan_memory(question), device.info());
  KernelConfig config = kernel_config(model.dim(), model.variant(), settings, device.info());
  config.depth = depth;
  config.backward = false;
  const DeviceGroups on_device(device, model, config);
  std::vector<std::uint32_t> views(split.views.size());
  for (std::size_t i = 0; i < views.size(); ++i) views[i] = static_cast<std::uint32_t>(i);
  const RenderSettings render = render_settings(settings);
  const auto draw = [&](Stages& with, const std::vector<std::uint32_t>& which) {
    Renderer renderer(device, with);
    renderer.set_cameras(cameras_of(split));
    renderer.forward(on_device.view(), which[0], render, false);
    device.finish();
    const Stopwatch watch;
    const std::vector<std::uint64_t> counts = count_views(renderer, on_device.view(), render, which);
    device.finish();
    plan.start.step_ms = watch.milliseconds() / static_cast<double>(counts.size());
    return counts;
  };
  const std::vector<std::uint64_t> counts = draw(on_device.stages(), views);
  take_counts(plan.start, counts);
  plan.start.measured = true;
  plan.end = plan.start;
  plan.views_measured = counts.size();
  for (const std::uint64_t count : counts) plan.intersection_room = room_after(plan.intersection_room, count);
  question.intersections = plan.intersection_room;
  plan.memory = plan_memory(question);
  check_fits(plan.memory, device.info());
  plan.seconds = 1e-3 * plan.start.step_ms * static_cast<double>(split.views.size());
  plan.stages = record_drawing(device, on_device, split, render);
  plan.programs = device.programs();
  return plan;
}

}  // namespace ubs
