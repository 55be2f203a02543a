// SPDX-License-Identifier: Apache-2.0
// RunPlan is the estimate of what a run requires: its memory, its kernels, the time of a step, and the number
// of intersections (pairs of a tile and a splat). The memory is computed from the sizes of all buffers
// (host/pipeline/memory_plan.hpp). The intersections and the time are measured twice: with the initial model,
// and with a model that has the final number of splats, which are copies of the initial splats.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "host/device/device.hpp"
#include "host/pipeline/memory_plan.hpp"
#include "host/pipeline/renderer.hpp"
#include "host/scene/dataset.hpp"
#include "host/scene/mixed_model.hpp"
#include "host/settings/settle.hpp"
#include "host/train/pyramid.hpp"

namespace ubs {

// PlanPoint holds the measurements for one number of splats.
struct PlanPoint {
  std::uint32_t splats = 0;
  double mean_intersections = 0;         // mean over the measured views
  std::uint64_t most_intersections = 0;  // maximum over the measured views
  double step_ms = 0;                    // time of an iteration, or of rendering a view
  bool measured = false;                 // false: extrapolated from another point
};

// PlanLevel is a level of the image pyramid. start_ms and end_ms are the times of a step with the initial and
// with the final number of splats.
struct PlanLevel {
  int factor = 1;
  int until = 0;  // last iteration of the level
  double start_ms = 0, end_ms = 0;
};

// StageUse describes how one operation was executed in a training step, or when a view was rendered.
struct StageUse {
  std::string stage;                 // operation of host/device/stages.hpp
  std::vector<std::string> kernels;  // kernels of the device, sorted by name
  double device_ms = 0;              // time of all these kernels, with the initial model
};

struct RunPlan {
  PlanPoint start, end;            // first and last iteration, with images of full size
  std::vector<PlanLevel> levels;   // only for training, which has at least one level
  std::size_t views_measured = 0;  // number of views whose intersections were counted
  int iterations = 0;              // number of training iterations; 0 for rendering
  double step_ms = 0;              // only for training: estimated mean over all iterations
  // Estimated time of all training iterations, or of rendering all views once.
  double seconds = 0;
  MemoryPlan memory;                    // memory at the end of the run
  std::uint64_t intersection_room = 0;  // capacity of the list buffers at the end of the run
  std::vector<StageUse> stages;
  std::vector<ProgramUse> programs;
  std::string note;  // reason why a part could not be measured
};

// Returns "fits", or a string that starts with "does not fit" and explains which limit is exceeded.
std::string memory_fit_text(const RunPlan& plan, const DeviceInfo& device);

// Estimates a training run. Throws Error(memory) if training would run out of memory before its first
// iteration.
RunPlan plan_training(Device& device, const Plan& training, const Split& train, const Split& test,
                      const SplatModel& initial);

// Estimates the time and the memory for rendering the views of a split in their order. `depth` is true if the
// depth is rendered too.
RunPlan plan_rendering(Device& device, const TrainSettings& settings, const Split& split,
                       const MixedModel& model, bool depth);

}  // namespace ubs
