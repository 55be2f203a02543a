// SPDX-License-Identifier: Apache-2.0
// Finds values of the kernels' tuned constants (host/opencl/tuning.hpp) by timing the stages concerned. One
// constant after the other, each with the values found so far. A value replaces another only when it is
// faster by more than the noise, twice, and leaves the results of a step as they are, up to rounding.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "host/bench/bench_scene.hpp"
#include "host/opencl/tuning.hpp"

namespace ubs::bench {

struct Trial {
  std::string macro;
  unsigned value = 0;
  double ratio = 0, uncertainty = 0;  // time over that of the value before; standard error of it
  double difference = 0;              // of the step's results, relative; 0: the same bits
  bool kept = false;
  std::string note;  // why there is no time
};

struct TuneOptions {
  RasterKind raster = RasterKind::cpu;
  bool quick = false;  // a small scene and few repetitions
  std::function<void(const Trial&)> on_trial;
};

// A ratio below 1 by more than two per cent and three standard errors.
bool clearly_faster(const Trial& trial);
// The largest |a - b| / |b| of all parts (Euclidean norms), infinite when they do not compare.
using Parts = std::vector<std::vector<float>>;
double relative_difference(const Parts& a, const Parts& b);

// The values that differ from the defaults. The device is left with them.
TuningValues tune(Device& device, const TuneOptions& options);

}  // namespace ubs::bench
