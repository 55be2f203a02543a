// SPDX-License-Identifier: Apache-2.0
// measure() measures the errors and times of configurations on one device and scene. They are timed in turns:
// each round runs every configuration once, so that other load on the machine affects all of them alike.
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

// Result is a row of the table: a configuration on a scene and a device.
struct Result {
  std::string form, truth;  // Configuration::label, truth_name()
  int dim = 0;              // N
  std::string scene, device;
  std::string note;          // not empty: the reason why the configuration does not run here
  double contributions = 0;  // Truth::contributions
  // "forward" has the error of the image. "iteration" (forward, loss, backward; no update) has the errors of
  // the gradients by parameter group. For "iteration", the exact image gradient is used as input, because the
  // sign of L1 is arbitrary where image and target agree within rounding. If the truth has the same variant,
  // the single stages on exact inputs follow.
  std::vector<TimedErrors> stages;
};

struct NamedScene {
  std::string name;
  bench::BenchScene scene;
  std::size_t view = 0;
  TrainSettings base = {};  // render settings; the settings of a configuration are applied on top of them
};

struct MeasureOptions {
  std::vector<Configuration> configurations;
  std::size_t rounds = 9;
  double sample_ms = 10;       // a stage is repeated until one sample takes this long
  std::function<bool()> stop;  // called between configurations and rounds; true: stop
  std::function<void(const std::string&)> on_progress;
};

// Returns the results in the order of the configurations, or fewer if stopped. Throws Error(usage) if none of
// them runs.
std::vector<Result> measure(Device& device, const NamedScene& scene, const MeasureOptions& options);

}  // namespace ubs::accuracy
