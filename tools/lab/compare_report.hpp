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
  double calls = 0, ms = 0;  // number of calls and total time for one forward and backward pass
};

struct TrainingResult {
  Json settings;  // as in config.yaml
  int iterations = 0;
  double seconds = 0;
  ViewMetrics test;
  std::uint32_t splats = 0;
  struct Spread {
    double mean = 0, deviation = 0;
  };
  std::vector<std::pair<std::string, Spread>> parameters;  // mean and standard deviation, by group
};

// The results of one device. All differences are those from the first device.
struct Comparison {
  std::string request;
  DeviceInfo device;
  std::string raster;
  // Maximum difference of a value of the image from that of the first device, and PSNR of the image against
  // the image of the first device [dB].
  double image_max = 0, image_psnr = 0;
  double loss = 0;
  std::vector<std::pair<std::string, double>> gradient;  // relative 2-norm of the difference, by group
  // Median wall times of the forward pass, and of the forward and the backward pass together.
  double forward_ms = 0, iteration_ms = 0;
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
