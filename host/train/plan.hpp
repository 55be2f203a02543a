// SPDX-License-Identifier: Apache-2.0
// What a run needs: memory from counting (host/pipeline/memory_plan.hpp), its kernels, and the intersections
// and the time of a step as measured with the model at its start and, copied, at its largest.
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
  double mean_intersections = 0;         // of a view
  std::uint64_t most_intersections = 0;  // of the views looked at
  double step_ms = 0;                    // of one iteration, or of one view rendered
  bool measured = false;                 // false: scaled from another point
};

// A level of the image pyramid, with the time of a step on its images at both numbers of splats.
struct PlanLevel {
  int factor = 1;
  int until = 0;  // its last iteration
  double start_ms = 0, end_ms = 0;
};

struct StageUse {
  std::string stage;                 // operation of host/device/stages.hpp
  std::vector<std::string> kernels;  // of the device, in order of name
  double device_ms = 0;              // of all of them, once, at the start
};

struct RunPlan {
  PlanPoint start, end;            // on whole images
  std::vector<PlanLevel> levels;   // of a training, one at least
  std::size_t views_measured = 0;  // for the intersections at the start
  int iterations = 0;              // 0: rendering
  double step_ms = 0;              // of a training: mean of all iterations, by the measured ones
  double seconds = 0;              // of all iterations like this; of drawing all views once
  MemoryPlan memory;               // at the end, with room for intersections as buffers grow
  std::uint64_t intersection_room = 0;
  std::vector<StageUse> stages;
  std::vector<ProgramUse> programs;
  std::string note;  // what could not be measured
};

// Returns "fits", or "does not fit: ..." with the numbers.
std::string fit_text(const RunPlan& plan, const DeviceInfo& device);

// Throws Error(memory) where training would before its first iteration.
RunPlan plan_training(Device& device, const TrainSettings& settings, const Split& train, const Split& test,
                      const SplatModel& initial);

// Of drawing the views of a split, in the order given. `depth`: with the depth channel.
RunPlan plan_rendering(Device& device, const TrainSettings& settings, const Split& split,
                       const MixedModel& model, bool depth);

}  // namespace ubs
