// SPDX-License-Identifier: Apache-2.0
// measure() measures the errors and times of configurations on one device and scene. The configurations are
// timed in turns: each round measures every configuration once, so that other load on the machine affects all
// of them alike.
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

// Result contains the measurements of one configuration on one scene and device. It is a row of the table.
struct Result {
  std::string form, truth;  // Configuration::label, truth_name()
  int dim = 0;              // N
  std::string scene, device;
  std::string note;          // reason why the configuration does not run on this device; empty if it runs
  double contributions = 0;  // Truth::contributions
  // The first two entries are "forward" and "iteration". "forward" has the error of the image. "iteration"
  // (forward, loss, backward; no update) has the errors of the gradients by parameter group. The input of
  // this backward pass is the exact image gradient, because the sign of the L1 gradient is arbitrary in
  // pixels in which image and target agree within rounding. If the reference has the same variant as the
  // configuration, one entry for each stage follows; the inputs of these stages are exact.
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
  double sample_ms = 10;       // [ms] a stage is repeated until a sample takes about this long
  std::function<bool()> stop;  // called between configurations and rounds; returns true to stop
  std::function<void(const std::string&)> on_progress;
};

// Returns the results in the order of the configurations. Returns fewer results if `stop` returned true.
// Throws Error(usage) if none of the configurations runs on the device.
std::vector<Result> measure(Device& device, const NamedScene& scene, const MeasureOptions& options);

}  // namespace ubs::accuracy
