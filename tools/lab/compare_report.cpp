// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/compare_report.hpp"

#include <algorithm>
#include <cmath>

#include "host/base/memory_limit.hpp"

namespace ubs::tools {
namespace {

// Returns all numbers of a row with their names, in the order of the page.
std::vector<std::pair<std::string, double>> quantities(const Comparison& row) {
  std::vector<std::pair<std::string, double>> list{
      {"image_max_difference", row.image_max}, {"image_difference_psnr", row.image_psnr}, {"loss", row.loss}};
  for (const auto& [group, error] : row.gradient) list.emplace_back("gradient_difference " + group, error);
  list.insert(list.end(), {{"forward_ms", row.forward_ms},
                           {"forward_backward_ms", row.iteration_ms},
                           {"peak_mib", mib(row.peak_bytes)}});
  for (const ComparedStage& stage : row.stages) list.emplace_back("stage_ms " + stage.name, stage.ms);
  if (const auto& t = row.training) {
    list.insert(list.end(), {{"train_iterations", t->iterations},
                             {"train_seconds", t->seconds},
                             {"train_splats", t->splats},
                             {"train_psnr", t->test.psnr_channel_mean},
                             {"train_ssim", t->test.ssim}});
    for (const auto& [group, spread] : t->parameters) {
      list.emplace_back("train_mean " + group, spread.mean);
      list.emplace_back("train_deviation " + group, spread.deviation);
    }
  }
  return list;
}

std::string value_text(double value) { return std::isfinite(value) ? fmt::format("{:.4g}", value) : "-"; }

std::string csv_text(std::string text) {
  for (std::size_t at = 0; (at = text.find('"', at)) != std::string::npos; at += 2) text.insert(at, 1, '"');
  return '"' + text + '"';
}

}  // namespace

double Comparison::worst_gradient() const {
  double worst = 0;
  for (const auto& [group, error] : gradient) {
    if (!std::isfinite(error)) return error;
    worst = std::max(worst, error);
  }
  return worst;
}

std::string table_text(const std::vector<Comparison>& rows) {
  std::string text = fmt::format("{:<44} {:>10} {:>10} {:>10} {:>10} {:>9} {:>9} {:>8}\n", "device",
                                 "image max", "gradient", "forward", "fwd+bwd", "memory", "train", "PSNR");
  text += fmt::format("{:<44} {:>10} {:>10} {:>10} {:>10} {:>9} {:>9} {:>8}\n", "", "difference",
                      "rel. diff.", "ms", "ms", "MiB", "s", "dB");
  for (const Comparison& row : rows) {
    const std::string how = fmt::format(" ({}, {})", row.device.backend, row.raster);
    const std::string name = row.device.name.substr(0, 44 - how.size()) + how;
    text +=
        fmt::format("{:<44} {:>10.2g} {:>10.2g} {:>10.3f} {:>10.3f} {:>9.1f} {:>9} {:>8}\n", name,
                    row.image_max, row.worst_gradient(), row.forward_ms, row.iteration_ms,
                    mib(row.peak_bytes), row.training ? fmt::format("{:.1f}", row.training->seconds) : "-",
                    row.training ? fmt::format("{:.2f}", row.training->test.psnr_channel_mean) : "-");
  }
  return text;
}

Json comparison_json(const std::vector<Comparison>& rows) {
  Json list = Json::array();
  for (const Comparison& row : rows) {
    Json values = Json::object();
    for (const auto& [name, value] : quantities(row)) values[name] = value;
    list.push_back({{"request", row.request},
                    {"device", device_json(row.device)},
                    {"raster", row.raster},
                    {"values", std::move(values)}});
    if (row.training) list.back()["training_settings"] = row.training->settings;
  }
  return list;
}

std::string comparison_csv(const std::vector<Comparison>& rows) {
  std::string text = "device,quantity,value\n";
  for (const Comparison& row : rows)
    for (const auto& [name, value] : quantities(row))
      text += fmt::format("{},{},{}\n", csv_text(row.request), csv_text(name), value);
  return text;
}

std::string comparison_page(const std::vector<Comparison>& rows, const std::string& title) {
  std::string text = fmt::format("# {}\n\nDifferences are against the first device.\n\n", title);
  for (const Comparison& row : rows)
    text += fmt::format("- `{}`: {}, rasteriser {}{}\n", row.request, describe(row.device), row.raster,
                        row.device.pci.empty() ? "" : ", PCI " + row.device.pci);
  std::vector<std::string> names;
  for (const Comparison& row : rows)
    for (const auto& [name, value] : quantities(row))
      if (std::ranges::find(names, name) == names.end()) names.push_back(name);
  text += "\n| quantity |";
  for (const Comparison& row : rows) text += fmt::format(" {} |", row.request);
  text += "\n|---|";
  for (std::size_t i = 0; i < rows.size(); ++i) text += "---:|";
  for (const std::string& name : names) {
    text += fmt::format("\n| {} |", name);
    for (const Comparison& row : rows) {
      const auto list = quantities(row);
      const auto found = std::ranges::find_if(list, [&](const auto& entry) { return entry.first == name; });
      text += fmt::format(" {} |", found == list.end() ? "" : value_text(found->second));
    }
  }
  return text + "\n";
}

}  // namespace ubs::tools
