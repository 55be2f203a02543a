// SPDX-License-Identifier: Apache-2.0
// Results of benchmark runs as a table, as JSON, and against an earlier JSON file.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <vector>

#include "host/lab/bench/runner.hpp"

namespace ubs::bench {

std::string table_header();
std::string table_row(const CaseResult& result);
// One row a case, one column of medians a device, ratios to the first; "" for a single device.
std::string device_comparison(std::span<const DeviceReport> reports);

nlohmann::ordered_json to_json(const DeviceReport& report);

// A measurement of a baseline file as far as comparison needs it.
struct BaselineEntry {
  std::string device, driver, raster, name, form;
  int dim = 0;
  double median_ms = 0, minimum_ms = 0, uncertainty = 0;
};
// The "devices" of a file written by `ubs-lab bench --json`. Throws Error(data) naming `origin`.
std::vector<BaselineEntry> read_baseline(const nlohmann::ordered_json& json, const std::string& origin);

struct Comparison {
  std::string name, device;
  double old_ms = 0, new_ms = 0;
  double ratio = 0;      // of medians, new / old
  double tolerance = 0;  // a ratio above 1 + this is beyond the noise
  bool same_driver = true;
  bool regression = false;
};

// Matches device, rasteriser, dimensions, form and name. A regression is slower in the median AND in the
// minimum by more than max(5 %, three standard errors of the two medians): a busy machine raises medians,
// seldom minima.
std::vector<Comparison> compare(std::span<const DeviceReport> reports,
                                std::span<const BaselineEntry> baseline);
std::string comparison_text(std::span<const Comparison> comparisons);

}  // namespace ubs::bench
