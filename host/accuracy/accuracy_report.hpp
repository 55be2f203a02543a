// SPDX-License-Identifier: Apache-2.0
// Results of `ubs accuracy` as a table on the terminal, CSV, JSON, a Markdown page and plots.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <vector>

#include "host/accuracy/measure.hpp"

namespace ubs::accuracy {

// What the results were measured with, for the page.
struct ReportHeader {
  std::vector<std::string> lines;  // "date ...", "device ...", "command ..."
  std::string plot;                // file name of the plot beside the page
};

// One scene of one device as a Markdown table, errors and times end to end.
std::string result_table(std::span<const Result> results, const std::string& device,
                         const std::string& scene);
// Largest relative error of each stage on exact inputs, with its quantity, and the stage's time ratio.
std::string stage_table(std::span<const Result> results, const std::string& device, const std::string& scene);

std::string accuracy_csv(std::span<const Result> results);
nlohmann::ordered_json accuracy_json(std::span<const Result> results);
std::string accuracy_page(std::span<const Result> results, const ReportHeader& header);
// Error against time for image and gradient side by side, a row a device: the means where there are several
// scenes.
std::string accuracy_plot(std::span<const Result> results);  // SVG

// In order of appearance.
std::vector<std::string> devices_of(std::span<const Result> results);
std::vector<std::string> scenes_of(std::span<const Result> results);

}  // namespace ubs::accuracy
