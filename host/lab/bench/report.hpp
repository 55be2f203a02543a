// SPDX-License-Identifier: Apache-2.0
// The functions of this file output the results of benchmark runs as a table and as JSON, and compare them
// with an earlier JSON file.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <vector>

#include "host/lab/bench/runner.hpp"

namespace ubs::bench {

std::string table_header();
std::string table_row(const CaseResult& result);
// Returns a table with one row per case and one column of medians per device, with ratios to the first
// device. Returns "" for a single device.
std::string device_comparison(std::span<const DeviceReport> reports);

nlohmann::ordered_json to_json(const DeviceReport& report);

// BaselineEntry is a measurement from a baseline file, with the values that are needed for the comparison.
struct BaselineEntry {
  std::string device, driver, raster, name, form;
  int dim = 0;
  double median_ms = 0, minimum_ms = 0, uncertainty = 0;
};
// Reads "devices" of a file that was written by `ubs-lab bench --json`. Throws Error(data) with a message
// that starts with `origin`.
std::vector<BaselineEntry> read_baseline(const nlohmann::ordered_json& json, const std::string& origin);

struct Comparison {
  std::string name, device;
  double old_ms = 0, new_ms = 0;
  double ratio = 0;      // ratio of the medians, new / old
  double tolerance = 0;  // a ratio above 1 + tolerance exceeds the noise
  bool same_driver = true;
  bool regression = false;
};

// Compares results with the same device, rasteriser, dimensions, variant and name. A result is a regression
// if its median is larger by more than 5 % and by more than three standard errors of the two medians, and if
// its minimum is larger by more than 5 %. The minimum is checked too, because load on the machine increases
// medians, but rarely minima.
std::vector<Comparison> compare(std::span<const DeviceReport> reports,
                                std::span<const BaselineEntry> baseline);
std::string comparison_text(std::span<const Comparison> comparisons);

}  // namespace ubs::bench
