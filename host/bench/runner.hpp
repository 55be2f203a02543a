// SPDX-License-Identifier: Apache-2.0
// Runs cases on a device: makes each scene once, measures ceilings first, reports every result as it comes.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "host/bench/bench_case.hpp"
#include "host/bench/ceilings.hpp"
#include "host/bench/training_bench.hpp"

namespace ubs::bench {

struct CaseResult {
  std::string name;  // of the case
  int dim = 6;
  std::string form = "default";  // to_string(ModelVariant)
  Summary wall_ms;               // no samples: see `note`
  double device_ms = 0;          // 0: not measured
  double cpu_ms = 0;             // processor time a core, CPU devices only; 0: not measured
  Cost cost;                     // zero: not counted
  Bound bound;
  WorkCounts counts;  // splats = 0: not counted
  std::uint64_t peak_bytes = 0;
  double core_trip_ns = 0;  // core_round_trip_ns() before or after the case, the larger; 0: not measured
  std::string note;

  // Of the limit that binds; 0 when unknown. Above 1 where data stay in caches that the limit ignores.
  double fraction_of_bound() const { return wall_ms.median > 0 ? bound.ms / wall_ms.median : 0; }
};

struct DeviceReport {
  DeviceInfo info;
  std::string raster;  // cpu or gpu
  CeilingRates ceilings;
  std::vector<CaseResult> results;
};

struct RunOptions {
  std::vector<BenchCase> cases;
  std::string raster = "auto";
  int dim = 6;
  bool quick = false;
  SamplingLimits limits;
  std::filesystem::path executable;  // for start-up cases
  std::filesystem::path garden;
  std::function<BenchScene()> open_model;  // for the scene "model"
  TrainSettings training;                  // the form (default for "synthetic") and kernel_assignments()
  std::function<void(const DeviceReport&)> on_begin;  // ceilings are there, results are not
  std::function<void(const CaseResult&)> on_result;
  // Asked before each case: true ends the run with the results so far.
  std::function<bool()> stop = [] { return false; };
};

// `device_request` is passed on to start-up processes. A case that does not fit into memory becomes a note.
DeviceReport run_cases(const std::string& device_request, const RunOptions& options);

// Dimensions of a scene's model: orbit has time, so 6 becomes 7 and 3 becomes 4 there.
int scene_dim(const std::string& scene, int dim);

}  // namespace ubs::bench
