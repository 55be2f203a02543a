// SPDX-License-Identifier: Apache-2.0
// What a run will need, before it runs: memory from counting (host/pipeline/memory_plan.hpp), intersections
// and the time of a step from measuring the model at its start and, copied, at its largest. docs/training.md
// says how good it is.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "host/device/device.hpp"
#include "host/pipeline/memory_plan.hpp"
#include "host/pipeline/renderer.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/mixed_model.hpp"
#include "host/spec/train_settings.hpp"
#include "host/train/pyramid.hpp"

namespace ubs {

struct PlanPoint {
  std::uint32_t splats = 0;
  double mean_intersections = 0;         // of a view
  std::uint64_t most_intersections = 0;  // of the views looked at
  double step_ms = 0;                    // of one iteration, or of one view rendered
  bool measured = false;                 // false: scaled from another point
};

// A level of the image pyramid, with the time of a step on its images at both numbers of splats.
struct PlanLevel {
  PyramidLevel level;
  double start_ms = 0, end_ms = 0;
  double sweep_ms = 0;  // of a step of all cameras, where they are refined
};

struct StageUse {
  std::string stage;                 // operation of host/device/stages.hpp
  std::vector<std::string> kernels;  // of the device, in order of name
  double device_ms = 0;              // of all of them, once, at the start
};

// What trainings came to over what their start lets expect: splats move and change their sizes. Fitted to
// twelve runs (docs/results/2026-11-22-plan.md).
struct PlanCorrection {
  double intersections = 1;  // of a view at most, at the end
  double seconds = 1;        // of the run; steps are right at its beginning and twice as far off at its end
};

// What trainings came to over what their plans said.
struct PlanInterval {
  double least = 1, most = 1;
};

struct RunPlan {
  PlanPoint start, end;                  // on whole images
  std::vector<PlanLevel> levels;         // of a training, one at least
  std::size_t views_measured = 0;        // for the intersections at the start
  int iterations = 0;                    // 0: rendering
  int grown_at = 0;                      // iteration that reaches the last number of splats
  double seconds = 0;                    // of training; of drawing all views once
  std::vector<double> curve;             // of a training: seconds after each percent of the iterations
  PlanCorrection correction;             // of a training: part of `end`, `seconds`, `curve` and memory
  PlanInterval intersections;            // of the most of a view at the end
  MemoryPlan memory;                     // at the end, with room for intersections as buffers grow
  MemoryPlan memory_least, memory_most;  // the same at the ends of `intersections`
  std::uint64_t intersection_room = 0;
  std::vector<StageUse> stages;  // only where asked for
  std::vector<ProgramUse> programs;
  std::string note;  // what could not be measured
};

// Intersections and the time of a step after a short run, over those expected of as many splats.
struct Spread {
  double intersections = 1, seconds = 1;
};

// `from_points`: splats begin at such.
PlanCorrection plan_correction(const TrainSettings& settings, bool from_points, const Spread& spread);
// Rates of short schedules spread splats so fast that a short run tells.
bool spreads_fast(const TrainSettings& settings);

// Of seconds, and of the most intersections of a view (same page).
inline constexpr PlanInterval kPlanInterval{0.7, 1.45}, kIntersectionsInterval{0.7, 2};

// Splats after each iteration follow from the settings where every refinement grows.
std::uint32_t splats_at(const TrainSettings& settings, std::size_t initial, int iteration);

// Seconds of the first iterations of a training: on each level the time of a step is linear in the splats
// between `start` and `end` of them, and constant where they are the same number.
double training_seconds(const TrainSettings& settings, const std::vector<PlanLevel>& levels,
                        std::uint32_t start, std::uint32_t end, int iterations);
// Expected seconds after each percent of the iterations.
std::vector<double> time_curve(const TrainSettings& settings, const std::vector<PlanLevel>& levels,
                               std::uint32_t start, std::uint32_t end);
// How time is spread over a run of which nothing is measured, in unknown units.
std::vector<double> assumed_curve(const TrainSettings& settings, std::size_t initial);

// "fits", or "may not fit: ..." at the upper end of the interval, or "does not fit: ..." at the lower one.
std::string fit_text(const RunPlan& plan, const DeviceInfo& device);

// Throws Error(memory) where training would before its first iteration. `from_points`: the data brought them;
// `stages`: also which kernels run.
RunPlan plan_training(Device& device, const TrainSettings& settings, const Split& train, const Split& test,
                      const SplatModel& initial, bool from_points, bool stages);

// Of drawing the views of a split, in the order given. `depth`: with the depth channel.
RunPlan plan_rendering(Device& device, const TrainSettings& settings, const Split& split,
                       const MixedModel& model, bool depth);

}  // namespace ubs
