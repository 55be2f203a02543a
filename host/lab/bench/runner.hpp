// SPDX-License-Identifier: Apache-2.0
// run_cases() runs benchmarks on a device. It creates each scene once and reports each result as soon as it
// is available.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "host/lab/bench/bench_case.hpp"
#include "host/lab/bench/training_bench.hpp"

namespace ubs::bench {

struct CaseResult {
  std::string name;  // name of the case
  int dim = 6;
  std::string form = "default";  // to_string(ModelVariant)
  Summary wall_ms;               // has no samples if the case failed; `note` then contains the reason
  double device_ms = 0;          // 0: not measured
  double cpu_ms = 0;             // processor time per core, only for CPU devices; 0: not measured
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
  bool quick = false;  // trains the built-in scenes for only 20 iterations instead of 300
  SamplingLimits limits;
  std::filesystem::path garden;            // folder of the scene "garden"
  std::function<BenchScene()> open_model;  // for the scene "model"
  // Only the variant, kernel_assignments() and list_counts are used. The scene "synthetic" ignores the
  // variant.
  TrainSettings training;
  // Called before the first case; the report has no results yet.
  std::function<void(const DeviceReport&)> on_begin;
  std::function<void(const CaseResult&)> on_result;
  // Called before each case. If it returns true, the run ends with the results so far.
  std::function<bool()> stop = [] { return false; };
};

// Measures the cases. If a case does not fit into memory, its result contains a note with the reason instead
// of times.
DeviceReport run_cases(Device& device, const RunOptions& options);

// Returns the number of dimensions of the model of a scene. The scene `orbit` changes over time, so for this
// scene 3 becomes 4 and 6 becomes 7.
int scene_dim(const std::string& scene, int dim);

}  // namespace ubs::bench
