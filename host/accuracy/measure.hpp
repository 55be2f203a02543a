// SPDX-License-Identifier: Apache-2.0
// Errors and times of configurations on one device and scene. Times are taken in turn: each round runs every
// configuration once and gives ratios to the first one in the same round; what else the machine does in the
// meantime falls on all of them.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "host/accuracy/configuration.hpp"
#include "host/accuracy/stage_run.hpp"
#include "host/bench/bench_scene.hpp"

namespace ubs::accuracy {

struct OperationTime {
  std::string operation;   // of timed_operations()
  double ms = 0;           // median of the rounds
  double ratio = 1;        // to the first configuration: median of the rounds
  double uncertainty = 0;  // standard error of that median, relative
};

struct Result {
  std::string device, scene, configuration, truth;
  std::string note;  // not empty: the configuration does not run here, and why
  // End to end, gradients by parameter group: `gradient` given the exact image gradient, `loss_gradient` with
  // the loss's own. L1 has a slope of +1 or -1: where image and target agree to rounding, the sign is a
  // matter of chance, and a few such pixels outweigh all other errors of the second one.
  StageErrors image, gradient, loss_gradient;
  std::vector<StageErrors> stages;  // each on exact inputs
  std::vector<OperationTime> times;
  bool image_front = false, gradient_front = false;  // among configurations of the same truth

  const OperationTime& time(const std::string& operation) const;
  double image_error() const { return image.quantities.at(0).errors.relative; }
  const NamedErrors& gradient_error() const { return worst(gradient.quantities); }
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
  double sample_ms = 10;        // an operation is repeated until it takes this long
  bool processor_time = false;  // times are those of the process's processors: for CPUs that others use too
  bool stages = true;           // errors stage by stage
  std::function<bool()> stop;   // asked between configurations and rounds
  std::function<void(const std::string&)> on_progress;
};

// In the order of the configurations; fewer than asked for when stopped. Throws Error(usage) when none runs.
std::vector<Result> measure(Device& device, const NamedScene& scene, const MeasureOptions& options);

// Geometric means over the scenes of a device, by configuration, as further results of the scene "all";
// nothing for a single scene. Marks fronts of all results anew.
void add_means(std::vector<Result>& results);
void mark_fronts(std::vector<Result>& results);

}  // namespace ubs::accuracy
