// SPDX-License-Identifier: Apache-2.0
// ReductionReport contains the results of `ubs reduce`. They are written as JSON and as a table.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "host/model/model_times.hpp"
#include "host/model/reducer.hpp"
#include "tools/common/output.hpp"

namespace ubs::tools {

// SplitChange is the image quality on a split before and after the reduction.
struct SplitChange {
  std::string name;
  std::size_t views = 0;
  ViewMetrics before, after;
};

struct SearchStep {
  double bound = 0, loss_db = 0;
  std::size_t parameters = 0;
};

struct ReductionReport {
  const MixedModel* before = nullptr;
  const reduce::Reduced* after = nullptr;
  const reduce::Reducer* reducer = nullptr;
  double bound = 0;  // bound of the chosen reduction; 0: lossless
  std::size_t bytes_before = 0, bytes_after = 0;
  std::array<reduce::ModelTimes, 2> times;
  std::vector<SplitChange> splits;  // the measured splits: train, test or both
  std::vector<SearchStep> search;
};

Json to_json(const ReductionReport& report);
void print_table(const ReductionReport& report);
// Prints one line: the file, numbers of splats, sizes, and PSNR.
void print_summary(const ReductionReport& report, const std::string& file);

// Returns a CSV table with one row per splat: its number of dimensions, the number of views in which it is
// visible, its maximum weight, and for each smaller number of dimensions the members of DimensionEffect
// (host/model/replacement.hpp).
std::string effects_csv(const ReductionReport& report);

}  // namespace ubs::tools
