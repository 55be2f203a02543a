// SPDX-License-Identifier: Apache-2.0
// Errors and times of a run against those of an earlier accuracy.json of `ubs accuracy`. Times are compared
// as ratios to the default of their own run, so that another machine or a busy one does not matter; only
// errors can fail.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "host/accuracy/measure.hpp"

namespace ubs::accuracy {

struct BaselineRow {
  std::string device, scene, configuration, stage, quantity;
  double error = 0, time_ratio = 0;  // the typical error: order flips of single splats are chance
};
// Throws Error(data).
std::vector<BaselineRow> read_accuracy_baseline(const std::filesystem::path& file);

struct BaselineComparison {
  std::string what;  // "glossy, default, end to end, image"
  double old_error = 0, error = 0;
  double old_time = 0, time = 0;  // ratios to the default
  bool regression = false;
};
// Rows that both have. A regression: an error above twice the old one and above 3e-7 (a few roundings).
std::vector<BaselineComparison> compare_with_baseline(std::span<const Result> results,
                                                      std::span<const BaselineRow> baseline);
// Regressions and the rows that changed most, then a summary line.
std::string baseline_text(std::span<const BaselineComparison> comparisons);

}  // namespace ubs::accuracy
