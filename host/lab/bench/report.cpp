// SPDX-License-Identifier: Apache-2.0
#include "host/lab/bench/report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "host/base/error.hpp"
#include "host/base/json.hpp"
#include "host/base/memory_limit.hpp"

namespace ubs::bench {
namespace {

constexpr double kMinRegression = 0.05, kStandardErrors = 3;

std::string ms_text(double ms) {
  if (ms <= 0) return "-";
  if (ms >= 10000) return fmt::format("{:.0f}", ms);
  return ms >= 100 ? fmt::format("{:.1f}", ms)
         : ms >= 1 ? fmt::format("{:.2f}", ms)
                   : fmt::format("{:.4f}", ms);
}

Json result_json(const CaseResult& r) {
  Json json{{"name", r.name},
            {"dim", r.dim},
            {"form", r.form},
            {"samples", r.wall_ms.samples},
            {"median_ms", r.wall_ms.median},
            {"minimum_ms", r.wall_ms.minimum},
            {"lower_quartile_ms", r.wall_ms.lower_quartile},
            {"upper_quartile_ms", r.wall_ms.upper_quartile},
            {"uncertainty", r.wall_ms.samples > 0 ? r.wall_ms.uncertainty() : 0},
            {"peak_bytes", r.peak_bytes}};
  if (r.wall_ms.samples == 0) json["median_ms"] = json["minimum_ms"] = nullptr;
  if (r.cpu_ms > 0) json["cpu_ms_a_core"] = r.cpu_ms;
  if (r.device_ms > 0) json["device_ms"] = r.device_ms;
  if (!r.note.empty()) json["note"] = r.note;
  return json;
}

}  // namespace

std::string table_header() {
  return fmt::format("{:<42} {:>2} {:>9} {:>9} {:>6} {:>9} {:>9} {:>8}", "case", "N", "median ms", "min ms",
                     "iqr %", "cpu ms", "device ms", "peak MiB");
}

std::string table_row(const CaseResult& r) {
  const double median = r.wall_ms.median;
  const double spread = median > 0 ? 100 * r.wall_ms.quartile_spread() / median : 0;
  return fmt::format(
      "{:<42} {:>2} {:>9} {:>9} {:>6} {:>9} {:>9} {:>8}  {}", r.name, r.dim, ms_text(median),
      ms_text(r.wall_ms.minimum), median > 0 ? fmt::format("{:.1f}", spread) : "-", ms_text(r.cpu_ms),
      ms_text(r.device_ms),
      r.peak_bytes > 0 ? fmt::format("{:.1f}", static_cast<double>(r.peak_bytes) / kMiB) : "-",
      r.form == "default" ? r.note : fmt::format("{}{}{}", r.note, r.note.empty() ? "" : ", ", r.form));
}

std::string device_comparison(std::span<const DeviceReport> reports) {
  if (reports.size() < 2) return "";
  std::string text = fmt::format("{:<42}", "median ms");
  for (std::size_t d = 0; d < reports.size(); ++d)
    text += fmt::format(" {:>26}", fmt::format("[{}] {}", d, reports[d].info.name).substr(0, 26));
  text += "\n";
  for (const CaseResult& first : reports[0].results) {
    text += fmt::format("{:<42}", first.name);
    for (const DeviceReport& report : reports) {
      const auto found = std::ranges::find(report.results, first.name, &CaseResult::name);
      const double ms = found == report.results.end() ? 0 : found->wall_ms.median;
      const bool both = ms > 0 && first.wall_ms.median > 0 && &report != &reports[0];
      text += fmt::format(" {:>16} {:>9}", ms_text(ms),
                          both ? fmt::format("x{:.2f}", ms / first.wall_ms.median) : "");
    }
    text += "\n";
  }
  return text;
}

Json to_json(const DeviceReport& report) {
  Json cases = Json::array();
  for (const CaseResult& result : report.results) cases.push_back(result_json(result));
  return {{"name", report.info.name},
          {"platform", report.info.platform},
          {"vendor", report.info.vendor},
          {"driver", report.info.driver},
          {"version", report.info.version},
          {"backend", report.info.backend},
          {"tuning", report.info.tuning},
          {"compute_units", report.info.compute_units},
          {"float_vector_width", report.info.float_vector_width},
          {"raster", report.raster},
          {"cases", std::move(cases)}};
}

std::vector<BaselineEntry> read_baseline(const Json& json, const std::string& origin) {
  std::vector<BaselineEntry> entries;
  try {
    for (const Json& device : json.at("devices"))
      for (const Json& result : device.at("cases")) {
        if (result.at("median_ms").is_null()) continue;
        entries.push_back({device.at("name"), device.at("driver"), device.at("raster"), result.at("name"),
                           result.value("form", "default"), result.at("dim"), result.at("median_ms"),
                           result.at("minimum_ms"), result.at("uncertainty")});
      }
  } catch (const nlohmann::json::exception&) {
    fail(ErrorKind::data, "{}: not a file written by 'ubs-lab bench --json'", origin);
  }
  return entries;
}

namespace {

Comparison compare_one(const DeviceReport& report, const CaseResult& now, const BaselineEntry& old) {
  Comparison c{now.name, report.info.name, old.median_ms, now.wall_ms.median};
  c.same_driver = old.driver == report.info.driver;
  c.tolerance =
      std::max(kMinRegression, kStandardErrors * std::hypot(old.uncertainty, now.wall_ms.uncertainty()));
  c.ratio = c.new_ms / c.old_ms;
  c.regression = c.ratio > 1 + c.tolerance && now.wall_ms.minimum > (1 + kMinRegression) * old.minimum_ms;
  return c;
}

}  // namespace

std::vector<Comparison> compare(std::span<const DeviceReport> reports,
                                std::span<const BaselineEntry> baseline) {
  std::vector<Comparison> comparisons;
  for (const DeviceReport& report : reports)
    for (const CaseResult& now : report.results) {
      const auto old = std::ranges::find_if(baseline, [&](const BaselineEntry& b) {
        return b.device == report.info.name && b.raster == report.raster && b.dim == now.dim &&
               b.form == now.form && b.name == now.name;
      });
      if (old != baseline.end() && now.wall_ms.samples > 0 && old->median_ms > 0 && old->minimum_ms > 0)
        comparisons.push_back(compare_one(report, now, *old));
    }
  return comparisons;
}

std::string comparison_text(std::span<const Comparison> comparisons) {
  std::string text = fmt::format("{:<42} {:>10} {:>10} {:>7} {:>8}\n", "against the baseline", "old ms",
                                 "new ms", "ratio", "noise");
  double logs = 0;
  for (const Comparison& c : comparisons) {
    logs += std::log(c.ratio);
    text += fmt::format("{:<42} {:>10} {:>10} {:>7.3f} {:>7.1f}% {}{}\n", c.name, ms_text(c.old_ms),
                        ms_text(c.new_ms), c.ratio, 100 * c.tolerance,
                        c.regression                ? "SLOWER"
                        : c.ratio < 1 - c.tolerance ? "faster"
                                                    : "",
                        c.same_driver ? "" : " (other driver)");
  }
  text += fmt::format("{:<42} {:>10} {:>10} {:>7.3f}\n", "geometric mean", "", "",
                      std::exp(logs / static_cast<double>(comparisons.size())));
  return text;
}

}  // namespace ubs::bench
