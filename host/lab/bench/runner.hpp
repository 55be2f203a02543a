// SPDX-License-Identifier: Apache-2.0
// run_cases() measures cases on a device: it makes each scene once and reports every result as it comes.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "host/lab/bench/bench_case.hpp"
#include "host/lab/bench/training_bench.hpp"

namespace ubs::bench {

struct CaseResult {
  std::string name;  // of the case
  int dim = 6;
  std::string form = "default";  // to_string(ModelVariant)
  Summary wall_ms;               // no samples: see `note`
  double device_ms = 0;          // 0: not measured
  double cpu_ms = 0;             // processor time a core, CPU devices only; 0: not measured
  std::uint64_t peak_bytes = 0;
  std::string note;
};

struct DeviceReport {
  DeviceInfo info;
  std::string raster;  // cpu or gpu
  std::vector<CaseResult> results;
};

struct RunOptions {
  std::vector<BenchCase> cases;
  std::string raster = "auto";
  int dim = 6;
  bool quick = false;
  SamplingLimits limits;
  std::filesystem::path garden;
  std::function<BenchScene()> open_model;  // for the scene "model"
  TrainSettings training;                  // the form (default for "synthetic") and kernel_assignments()
  std::function<void(const DeviceReport&)> on_begin;  // without results
  std::function<void(const CaseResult&)> on_result;
  // Asked before each case: true ends the run with the results so far.
  std::function<bool()> stop = [] { return false; };
};

// A case that does not fit into memory becomes a note.
DeviceReport run_cases(Device& device, const RunOptions& options);

// Dimensions of a scene's model: orbit has time, so 6 becomes 7 and 3 becomes 4 there.
int scene_dim(const std::string& scene, int dim);

}  // namespace ubs::bench
