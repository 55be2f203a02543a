// SPDX-License-Identifier: Apache-2.0
// An experiment (data_specs/experiments/*.yaml): methods (rows: settings with a label) times scenes of data
// sets, with the published values to stand beside ours. What was not published is left out or null, never
// guessed.
#pragma once

#include <map>
#include <optional>

#include "host/experiment/data_set_spec.hpp"

namespace ubs::experiment {

inline constexpr const char* kAverage = "average";  // stands in the place of a scene

// A measured quantity that tables have a column for.
struct Metric {
  const char* key;         // in files
  const char* name;        // heads the column
  const char* definition;  // exactly what it is in our results
  int decimals;
  bool quality;  // of images: gets a column of differences; others are costs
};
// psnr, ssim, lpips, minutes, fps, splats, mib.
std::span<const Metric> metrics();

struct RowSpec {
  std::string name, label;
  std::vector<Assignment> settings;
  // Values by "set/scene" and metric; the scene may be kAverage.
  std::map<std::string, std::map<std::string, double>> published;
};

struct DataEntry {
  DataSetSpec set;
  std::vector<std::string> scenes;  // of the set, in its order
  std::vector<Assignment> settings;
};

struct ExperimentSpec {
  std::filesystem::path file;
  std::string name, title, source, notes;  // source: of the published values
  std::vector<Assignment> settings;
  std::vector<RowSpec> rows;
  std::vector<DataEntry> data;
};

// Paths of data sets are relative to the file.
ExperimentSpec load_experiment_spec(const std::filesystem::path& path);

}  // namespace ubs::experiment
