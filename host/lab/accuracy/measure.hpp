// SPDX-License-Identifier: Apache-2.0
// Errors and times of forms on one device and scene. Times are taken in turns: each round runs every form
// once, so that what else the machine does in the meantime falls on all of them.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "host/check/stage_run.hpp"
#include "host/lab/accuracy/configuration.hpp"
#include "host/lab/bench/bench_scene.hpp"

namespace ubs::accuracy {

struct TimedErrors : check::StageErrors {
  double ms = 0;  // median over the rounds
};

// Result is a row of the table: a form on a scene and device.
struct Result {
  std::string form, truth;  // Configuration::label, truth_name()
  int dim = 0;              // N
  std::string scene, device;
  std::string note;  // not empty: why the form does not run here
  // "forward" has the error of the image, "iteration" (forward, loss, backward; no update) those of the
  // gradients by parameter group, given the exact image gradient: the sign of L1 is a matter of chance where
  // image and target agree to rounding. Then each stage alone on exact inputs, where the truth has the same
  // form.
  std::vector<TimedErrors> stages;
};

struct NamedScene {
  std::string name;
  bench::BenchScene scene;
  std::size_t view = 0;
  TrainSettings base = {};  // how it is drawn; those of a configuration come on top
};

struct MeasureOptions {
  std::vector<Configuration> configurations;
  std::size_t rounds = 9;
  double sample_ms = 10;       // a stage is repeated until it takes this long
  std::function<bool()> stop;  // asked between configurations and rounds
  std::function<void(const std::string&)> on_progress;
};

// In the order of the configurations; fewer than asked for when stopped. Throws Error(usage) when none runs.
std::vector<Result> measure(Device& device, const NamedScene& scene, const MeasureOptions& options);

}  // namespace ubs::accuracy
