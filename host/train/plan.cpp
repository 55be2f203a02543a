// SPDX-License-Identifier: Apache-2.0
#include "host/train/plan.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <set>

#include "host/base/error.hpp"
#include "host/base/stopwatch.hpp"
#include "host/device/operations.hpp"
#include "host/pipeline/device_groups.hpp"
#include "host/scene/frozen_groups.hpp"
#include "host/train/budget.hpp"
#include "host/train/rehearsal.hpp"
#include "host/train/run_settings.hpp"
#include "host/train/schedule.hpp"
#include "host/train/stage_recorder.hpp"
#include "host/train/timeline.hpp"
#include "host/train/trainer.hpp"

namespace ubs {
namespace {

constexpr double kViewSeconds = 1;  // spent on intersections of views, at most
constexpr std::size_t kMinViews = 8, kMaxViews = 256;
constexpr std::uint32_t kMaxCopied = 4'000'000;  // splats at the end; three host copies of 140 bytes each
// The run that shows how splats spread: mostly on small images, where a step takes a tenth. Moving scenes
// need more steps (docs/results/2026-11-22-plan.md).
constexpr int kSpreadIterations = 400, kMovingSpreadIterations = 800;
constexpr const char* kSpreadPyramid = "4:0.85,2:0.95";
constexpr std::size_t kSpreadViews = 20;  // drawn after it
constexpr std::size_t kSpreadGrowth = 3;  // most splats after it over those before
constexpr double kFastScale = 0.01;       // lr_scale between the published one and that of short runs
constexpr std::size_t kEndViews = 3;      // drawn at the last number of splats
constexpr double kStepSeconds = 0.3;  // spent on the time of a step, but kMinSamples samples of kStepsASample
constexpr int kWarmUp = 2, kMinSamples = 3, kMaxSamples = 25, kStepsASample = 2;
// A step on images of a quarter of the width takes a tenth (docs/budget.md); with twice the splats 1.7 times.
constexpr double kQuarterStep = 0.1, kSplatsShare = 0.7;

// The same run without what would change or interrupt the model while it is measured.
TrainSettings quiet(TrainSettings s) {
  s.refine.end = s.refine.first;
  s.iterations = std::max(s.iterations, 1000000);
  s.eval_every = "0";
  s.log_every = kStepsASample;
  if (s.on_nan != OnNan::off) s.on_nan = OnNan::stop;
  return s;
}

// Draws views in the order of training until the time is spent.
template <typename Splats>  // a view of one model, or groups
std::vector<std::uint64_t> count_views(Renderer& renderer, const Splats& splats,
                                       const RenderSettings& settings,
                                       const std::vector<std::uint32_t>& views) {
  std::vector<std::uint64_t> counts;
  const auto start = Clock::now();
  for (const std::uint32_t view : views) {
    if (counts.size() >= kMaxViews || (counts.size() >= kMinViews && seconds_since(start) > kViewSeconds))
      break;
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

// Median over samples of the trainer's own clock.
double step_ms(Trainer& trainer) {
  int reports = 0;
  double before = 0;
  std::vector<double> samples;
  const auto start = Clock::now();
  trainer.run([&](const StepReport& report) {
    if (!report.loss) return true;
    if (++reports * kStepsASample > kWarmUp) samples.push_back((report.seconds - before) / kStepsASample);
    before = report.seconds;
    const auto count = static_cast<int>(samples.size());
    return count < kMinSamples || (count < kMaxSamples && seconds_since(start) < kStepSeconds);
  });
  std::ranges::nth_element(samples, samples.begin() + static_cast<std::ptrdiff_t>(samples.size() / 2));
  return 1e3 * samples[samples.size() / 2];
}

// The same on every level of the run, the last one of whole images. `still`: the settings of `trainer`.
void measure_levels(Trainer& trainer, const TrainSettings& still, const Split& train, TrainState state,
                    RunPlan& plan, double PlanLevel::*to) {
  const std::vector<PyramidLevel> as_trained = pyramid_levels(still, train);
  for (PlanLevel& level : plan.levels) {
    const auto same = std::ranges::find(as_trained, level.level.factor, &PyramidLevel::factor);
    state.iteration = state.logged = same == as_trained.begin() ? 0 : std::prev(same)->until;
    trainer.restore(state);
    level.*to = step_ms(trainer);
    level.sweep_ms = 1e3 * trainer.sweep_seconds();
  }
}

// Of a run of which only steps on whole images are known.
std::vector<PlanLevel> assumed_levels(const TrainSettings& settings, double start_ms, double end_ms) {
  const Timeline time(settings);
  std::vector<PlanLevel> levels;
  const auto add = [&](int factor, double share) {
    const double part = std::pow(kQuarterStep, std::log(factor) / std::log(4));
    const int until = time.nearest(share * time.length());
    levels.push_back({{factor, until}, part * start_ms, part * end_ms});
  };
  for (const PyramidStep& step : pyramid_steps(settings)) add(step.factor, step.share);
  add(1, 1);
  return levels;
}

constexpr double kRoomGrowth = 1.5;  // at least, of a buffer that grows (Buffer::reserve)

// What such a buffer ends with after these requests.
std::uint64_t room_after(std::uint64_t room, std::uint64_t request) {
  return request <= room ? room : std::max(request, room + room / 2);
}

// From the start's measured views on, as the number of splats grows and they change.
std::uint64_t room_at_end(const RunPlan& plan, const TrainSettings& settings,
                          const std::vector<std::uint64_t>& first_views) {
  std::uint64_t room = 0;
  for (const std::uint64_t count : first_views) room = room_after(room, count);
  const double p0 = plan.start.splats, p1 = plan.end.splats;
  const double i0 = static_cast<double>(plan.start.most_intersections),
               i1 = static_cast<double>(plan.end.most_intersections);
  const double c = plan.correction.intersections;
  for (int k = 1; k <= 100; ++k) {
    const auto iteration = static_cast<int>(std::int64_t{k} * settings.iterations / 100);
    const double splats = splats_at(settings, plan.start.splats, iteration);
    const double grown = p1 > p0 ? i0 + (i1 / c - i0) * (splats - p0) / (p1 - p0) : i0;
    room = room_after(room, static_cast<std::uint64_t>(grown * (1 + (c - 1) * k / 100)));
  }
  return room;
}

// One pass of everything that training does, for the kernels that it takes.
std::vector<StageUse> record_stages(Device& device, const TrainSettings& settings, const Split& train,
                                    const SplatModel& initial) {
  Rehearsal rehearsal(device, settings, train.views[0], initial);
  rehearsal.learn(rehearsal.stages());  // kernels are compiled, images uploaded
  device.set_profiling(true);
  StageLog log(device);
  StageRecorder recorder(log, rehearsal.stages());
  rehearsal.learn(recorder);
  device.set_profiling(false);
  return log.uses();
}

// One view drawn: the projection of each group, then lists and rasteriser of all.
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

// Intersections of the trainer's model over those counted before, in the first views.
double grown_intersections(Trainer& trainer, const std::vector<std::uint32_t>& views,
                           const std::vector<std::uint64_t>& counted, std::size_t most) {
  double before = 0, after = 0;
  for (std::size_t k = 0; k < std::min({most, views.size(), counted.size()}); ++k) {
    before += static_cast<double>(counted[k]);
    after += static_cast<double>(
        trainer.renderer()
            .forward(trainer.device_model().view(), views[k], trainer.render_settings(), true)
            .intersections);
  }
  return before > 0 ? after / before : 0;
}

// The step and its intersections with the model copied to its last size.
void measure_end(Trainer& trainer, const TrainSettings& still, const Split& train, const SplatModel& initial,
                 const std::vector<std::uint32_t>& views, const std::vector<std::uint64_t>& first_views,
                 RunPlan& plan) {
  TrainState grown = trainer.state();
  grown.model = copies(initial, plan.end.splats);
  const ParameterLayout layout = grown.model.layout();
  grown.moment1.assign(
      grown.model.count * static_cast<std::size_t>(trained_rows(layout, frozen_groups(layout, still.freeze))),
      0.0f);
  grown.moment2 = grown.moment1;
  std::ranges::fill(grown.loss_sums, 0.0f);
  trainer.restore(grown);  // on the cameras of the last level
  const double counted = grown_intersections(trainer, views, first_views, kEndViews);
  const double ratio = counted > 0 ? counted : 1;
  plan.end.mean_intersections = ratio * plan.start.mean_intersections;
  plan.end.most_intersections =
      static_cast<std::uint64_t>(ratio * static_cast<double>(plan.start.most_intersections));
  measure_levels(trainer, still, train, std::move(grown), plan, &PlanLevel::end_ms);
  plan.end.step_ms = plan.levels.back().end_ms;
  plan.end.measured = true;
}

// After a short run that grows: intersections of the views counted, and the time of a step on whole images,
// over those expected of as many splats. A step never becomes cheaper than the first one.
Spread spread_of(Device& device, const TrainSettings& settings, const Split& train, const SplatModel& initial,
                 const std::vector<std::uint32_t>& views, const std::vector<std::uint64_t>& first_views,
                 const RunPlan& plan) {
  TrainSettings pilot = settings;
  pilot.pyramid = kSpreadPyramid;
  pilot.cap_max = static_cast<int>(std::min<std::size_t>(plan.end.splats, kSpreadGrowth * initial.count));
  const int iterations = has_time(settings.dim) ? kMovingSpreadIterations : kSpreadIterations;
  // Nobody's run: spelling out what a run has anyway does not change its plan. But these are its splats.
  pilot.chosen = {"cap_max"};
  pilot = short_schedule(pilot, std::min(iterations, settings.iterations), initial.count);
  pilot.on_nan = OnNan::stop;
  pilot.refine_cameras = RefineCameras::none;
  const Split none{"test", {}};
  const auto learn = [&] {
    Trainer trainer(device, pilot, train, none, initial);
    trainer.run([](const StepReport&) { return true; });
    return trainer.model();
  };
  const TrainSettings still = quiet(settings);
  Trainer trainer(device, still, train, none, learn());
  RunPlan spread;
  spread.levels = {plan.levels.back()};
  measure_levels(trainer, still, train, trainer.state(), spread, &PlanLevel::start_ms);
  const double counted = grown_intersections(trainer, views, first_views, kSpreadViews);
  const double grown = plan.end.splats > plan.start.splats
                           ? (trainer.device_model().count() - double{1} * plan.start.splats) /
                                 (double{1} * plan.end.splats - plan.start.splats)
                           : 0;
  const auto of_copies = [&](double PlanPoint::*cost) {
    return plan.start.*cost + grown * (plan.end.*cost - plan.start.*cost);
  };
  return {
      counted > 0 ? counted * plan.start.mean_intersections / of_copies(&PlanPoint::mean_intersections) : 1,
      std::max(spread.levels.back().start_ms, plan.start.step_ms) / of_copies(&PlanPoint::step_ms)};
}

// Everything that is proportional to splats or intersections.
void scale_end(RunPlan& plan) {
  const double ratio = static_cast<double>(plan.end.splats) / plan.start.splats;
  plan.end.mean_intersections = ratio * plan.start.mean_intersections;
  plan.end.most_intersections =
      static_cast<std::uint64_t>(ratio * static_cast<double>(plan.start.most_intersections));
  plan.end.step_ms = ratio * plan.start.step_ms;
  for (PlanLevel& level : plan.levels) level.end_ms = ratio * level.start_ms;
}

// Of the views, of which each is drawn once before any is drawn again: images go to the device when they are.
double share_drawn_whole(const TrainSettings& settings, const std::vector<PlanLevel>& levels,
                         std::size_t views) {
  const int before = levels.size() > 1 ? levels[levels.size() - 2].level.until : 0;
  return std::min(1.0,
                  double{1} * (settings.iterations - before) * settings.batch / static_cast<double>(views));
}

void apply_correction(RunPlan& plan) {
  plan.end.mean_intersections *= plan.correction.intersections;
  plan.end.most_intersections = static_cast<std::uint64_t>(plan.correction.intersections *
                                                           static_cast<double>(plan.end.most_intersections));
  std::vector<double> curve{0};
  for (std::size_t k = 1; k < plan.curve.size(); ++k) {
    const double share = (static_cast<double>(k) - 0.5) / static_cast<double>(plan.curve.size() - 1);
    curve.push_back(curve.back() + (plan.curve[k] - plan.curve[k - 1]) *
                                       std::max(0.1, 1 + 2 * (plan.correction.seconds - 1) * share));
  }
  const double whole = plan.correction.seconds * plan.curve.back() / curve.back();
  for (double& seconds : curve) seconds *= whole;
  plan.curve = std::move(curve);
}

}  // namespace

bool spreads_fast(const TrainSettings& s) { return s.lr_scale >= kFastScale; }

PlanCorrection plan_correction(const TrainSettings& s, bool from_points, const Spread& spread) {
  if (s.lr_scale == 0) return {};  // what has its size keeps it
  if (spreads_fast(s)) return {1.15 * spread.intersections, 1.1 * std::pow(spread.seconds, 0.6)};
  return from_points ? PlanCorrection{1.45, 1.2} : PlanCorrection{1.14, 1.05};
}

std::uint32_t splats_at(const TrainSettings& s, std::size_t initial, int iteration) {
  return Schedule(s, initial).splats_at(iteration);
}

double training_seconds(const TrainSettings& settings, const std::vector<PlanLevel>& levels,
                        std::uint32_t start, std::uint32_t end, int iterations) {
  const Schedule schedule(settings, start);
  const int every = schedule.refine_every();
  double total = 0;
  int first = 1;
  for (const PlanLevel& level : levels) {
    const double slope = end > start ? (level.end_ms - level.start_ms) / (double{1} * end - start) : 0;
    const int last = std::min(level.level.until, iterations);
    if (settings.refine_cameras != RefineCameras::none)
      total += level.sweep_ms * (schedule.camera_sweeps_by(last) - schedule.camera_sweeps_by(first - 1));
    while (first <= last) {
      const int next = std::min((first - 1) / every * every + every, last) + 1;
      const double more = static_cast<double>(schedule.splats_at(first)) - start;
      total += (level.start_ms + slope * more) * (next - first);
      first = next;
    }
  }
  return total * 1e-3;
}

std::vector<double> time_curve(const TrainSettings& settings, const std::vector<PlanLevel>& levels,
                               std::uint32_t start, std::uint32_t end) {
  std::vector<double> curve;
  for (int percent = 0; percent <= 100; ++percent)
    curve.push_back(training_seconds(settings, levels, start, end,
                                     static_cast<int>(std::int64_t{percent} * settings.iterations / 100)));
  return curve;
}

std::vector<double> assumed_curve(const TrainSettings& settings, std::size_t initial) {
  const auto start = static_cast<std::uint32_t>(initial),
             end = splats_at(settings, initial, settings.iterations);
  const double grown = initial > 0 ? 1 + kSplatsShare * (double{1} * end / start - 1) : 1;
  return time_curve(settings, assumed_levels(settings, 1, grown), start, end);
}

std::string fit_text(const RunPlan& plan, const DeviceInfo& device) {
  if (const std::string why = memory_shortage(plan.memory_least, device); !why.empty())
    return "does not fit: " + why;
  if (const std::string why = memory_shortage(plan.memory_most, device); !why.empty())
    return fmt::format("may not fit, with {:.2g} times the intersections: {}", plan.intersections.most, why);
  return "fits";
}

RunPlan plan_training(Device& device, const TrainSettings& asked, const Split& train, const Split& test,
                      const SplatModel& initial, bool from_points, bool stages) {
  const TrainSettings settings = resolve_automatic(asked);
  RunPlan plan;
  plan.iterations = settings.iterations;
  plan.start.splats = static_cast<std::uint32_t>(initial.count);
  plan.end.splats = splats_at(settings, initial.count, settings.iterations);
  for (plan.grown_at = 0; splats_at(settings, initial.count, plan.grown_at) < plan.end.splats;)
    plan.grown_at += std::max(1, settings.iterations / 300);
  const std::size_t capacity = std::max(initial.count, static_cast<std::size_t>(settings.cap_max));
  MemoryQuestion question = memory_question(settings, train, test, device.info(), capacity);
  question.refinement = !settings.refine.empty();
  check_fits(plan_memory(question), device.info());
  if (stages) {
    plan.stages = record_stages(device, settings, train, initial);
    plan.programs = device.programs();
  }

  ViewOrder order(settings.seed, static_cast<std::uint32_t>(train.views.size()));
  std::vector<std::uint32_t> views;
  for (std::uint64_t draw = 0; draw < train.views.size(); ++draw) views.push_back(order(draw));
  const Split none{"test", {}};
  std::vector<std::uint64_t> counts;
  {
    const TrainSettings still = quiet(settings);
    Trainer trainer(device, still, train, none, initial);
    counts = count_views(trainer.renderer(), trainer.device_model().view(), trainer.render_settings(), views);
    take_counts(plan.start, counts);
    plan.views_measured = counts.size();
    for (const PyramidLevel& level : pyramid_levels(settings, train)) plan.levels.push_back({.level = level});
    measure_levels(trainer, still, train, trainer.state(), plan, &PlanLevel::start_ms);
    plan.start.step_ms = plan.levels.back().start_ms;
    plan.start.measured = true;
    if (plan.end.splats == plan.start.splats) {
      plan.end = plan.start;
      for (PlanLevel& level : plan.levels) level.end_ms = level.start_ms;
    } else {
      try {
        if (plan.end.splats > kMaxCopied)
          fail(ErrorKind::memory, "more than {} are not copied for a plan", kMaxCopied);
        measure_end(trainer, still, train, initial, views, counts, plan);
      } catch (const Error& error) {
        if (error.kind() != ErrorKind::memory) throw;
        scale_end(plan);
        plan.note = fmt::format("{} splats could not be measured: {}", plan.end.splats, error.what());
      }
    }
  }
  plan.curve = time_curve(settings, plan.levels, plan.start.splats, plan.end.splats);
  const Spread spread =
      spreads_fast(settings) ? spread_of(device, settings, train, initial, views, counts, plan) : Spread{};
  plan.correction = plan_correction(settings, from_points, spread);
  apply_correction(plan);
  if (plan.correction.intersections != 1)  // else they are known
    plan.intersections = kIntersectionsInterval;
  plan.intersection_room = room_at_end(plan, settings, counts);
  const auto memory_with = [&](std::uint64_t room) {
    question.intersections = room;
    return plan_memory(question);
  };
  const auto most = static_cast<double>(plan.end.most_intersections);
  plan.memory = memory_with(plan.intersection_room);
  plan.memory_least = plan.memory_most = plan.memory;
  if (plan.intersections.most > 1) {
    plan.memory_most = memory_with(static_cast<std::uint64_t>(kRoomGrowth * plan.intersections.most * most));
    question.target_bytes =
        static_cast<std::uint64_t>(share_drawn_whole(settings, plan.levels, train.views.size()) *
                                   static_cast<double>(question.target_bytes));
    plan.memory_least = memory_with(static_cast<std::uint64_t>(plan.intersections.least * most));
  }
  plan.seconds = plan.curve.back();
  return plan;
}

RunPlan plan_rendering(Device& device, const TrainSettings& settings, const Split& split,
                       const MixedModel& model, bool depth) {
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
    const auto start = Clock::now();
    const std::vector<std::uint64_t> counts = count_views(renderer, on_device.view(), render, which);
    device.finish();
    plan.start.step_ms = 1e3 * seconds_since(start) / static_cast<double>(counts.size());
    return counts;
  };
  const std::vector<std::uint64_t> counts = draw(on_device.stages(), views);
  take_counts(plan.start, counts);
  plan.start.measured = true;
  plan.end = plan.start;
  plan.views_measured = counts.size();
  for (const std::uint64_t count : counts) plan.intersection_room = room_after(plan.intersection_room, count);
  question.intersections = plan.intersection_room;
  plan.memory = plan.memory_least = plan.memory_most = plan_memory(question);
  check_fits(plan.memory, device.info());
  plan.seconds = 1e-3 * plan.start.step_ms * static_cast<double>(split.views.size());
  plan.stages = record_drawing(device, on_device, split, render);
  plan.programs = device.programs();
  return plan;
}

}  // namespace ubs
