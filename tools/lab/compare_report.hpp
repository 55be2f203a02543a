// SPDX-License-Identifier: Apache-2.0
// Comparison contains the measurements of `ubs-lab compare` on one device. The functions of this file format
// the results as a table, JSON, CSV or a page.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "host/device/device.hpp"
#include "host/scene/splat_model.hpp"
#include "tools/common/output.hpp"

namespace ubs::tools {

struct ComparedStage {
  std::string name;
  double calls = 0, ms = 0;  // for one forward and backward
};

struct TrainingResult {
  int iterations = 0;
  double seconds = 0;
  ViewMetrics test;
  std::uint32_t splats = 0;
  struct Spread {
    double mean = 0, deviation = 0;
  };
  std::vector<std::pair<std::string, Spread>> parameters;  // by group
};

// All differences are relative to the first device.
struct Comparison {
  std::string request;
  DeviceInfo device;
  std::string raster;
  // Maximum difference of a value, and the difference as PSNR [dB].
  double image_max = 0, image_psnr = 0;
  double loss = 0;
  std::vector<std::pair<std::string, double>> gradient;  // relative 2-norm of the difference, by group
  double forward_ms = 0, iteration_ms = 0;               // wall time, medians
  std::vector<ComparedStage> stages;
  std::uint64_t peak_bytes = 0;
  std::optional<TrainingResult> training;

  double worst_gradient() const;
};

std::string table_text(const std::vector<Comparison>& rows);
Json comparison_json(const std::vector<Comparison>& rows);
std::string comparison_csv(const std::vector<Comparison>& rows);  // device,quantity,value
// Returns the results as a page in Markdown.
std::string comparison_page(const std::vector<Comparison>& rows, const std::string& title);

}  // namespace ubs::tools
