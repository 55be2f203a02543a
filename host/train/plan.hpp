// SPDX-License-Identifier: Apache-2.0
// RunPlan is the estimate of the requirements of a run: its memory, its kernels, and the intersections and
// the time of a step. The memory is computed from the sizes of all buffers (host/pipeline/memory_plan.hpp).
// The intersections and the time are measured with the initial model and with copies of it that have the
// final number of splats.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "host/device/device.hpp"
#include "host/pipeline/memory_plan.hpp"
#include "host/pipeline/renderer.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/mixed_model.hpp"
#include "host/scene/train_settings.hpp"
#include "host/train/pyramid.hpp"

namespace ubs {

struct PlanPoint {
  std::uint32_t splats = 0;
  double mean_intersections = 0;         // per view
  std::uint64_t most_intersections = 0;  // maximum over the measured views
  double step_ms = 0;                    // per iteration, or per rendered view
  bool measured = false;                 // false: scaled from another point
};

// A level of the image pyramid, with the time of a step at the initial and at the final number of splats.
struct PlanLevel {
  int factor = 1;
  int until = 0;  // its last iteration
  double start_ms = 0, end_ms = 0;
};

struct StageUse {
  std::string stage;                 // operation of host/device/stages.hpp
  std::vector<std::string> kernels;  // kernels of the device, sorted by name
  double device_ms = 0;              // time of all these kernels in one step at the start
};

struct RunPlan {
  PlanPoint start, end;            // on images of full size
  std::vector<PlanLevel> levels;   // for a training: at least one level
  std::size_t views_measured = 0;  // number of views in which the intersections were counted at the start
  int iterations = 0;              // 0: rendering
  double step_ms = 0;              // for a training: estimated mean over all iterations
  double seconds = 0;  // for a training: of all iterations; for rendering: of rendering all views once
  MemoryPlan memory;   // at the end of the run, with list buffers of intersection_room
  std::uint64_t intersection_room = 0;
  std::vector<StageUse> stages;
  std::vector<ProgramUse> programs;
  std::string note;  // reason why a part could not be measured
};

// Returns "fits", or "does not fit: ..." with the numbers.
std::string fit_text(const RunPlan& plan, const DeviceInfo& device);

// Estimates a training. Throws Error(memory) if training would run out of memory before its first iteration.
RunPlan plan_training(Device& device, const TrainSettings& settings, const Split& train, const Split& test,
                      const SplatModel& initial);

// Estimates rendering the views of a split in the given order. `depth`: with the depth channel.
RunPlan plan_rendering(Device& device, const TrainSettings& settings, const Split& split,
                       const MixedModel& model, bool depth);

}  // namespace ubs
