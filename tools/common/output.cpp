// SPDX-License-Identifier: Apache-2.0
#include "tools/common/output.hpp"

#include <algorithm>
#include <cmath>

#include "host/base/json.hpp"
#include "host/run/open_data.hpp"

namespace ubs::tools {
namespace {

Json view_json(const ViewMetrics& m) {
  Json json{{"name", m.name}};
  if (!m.part_of.empty()) json["part_of"] = m.part_of;
  json.update(quality_json(m));
  if (m.ssim_valid) json["ssim_valid"] = *m.ssim_valid;
  for (const NamedValue& distance : m.lpips) json[distance.name] = distance.value;
  if (m.fitted) json["fitted"] = quality_json(*m.fitted);
  if (m.posed) json["fitted_pose"] = quality_json(*m.posed);
  return json;
}

}  // namespace

void print_report(const LoadReport& report) {
  say("data     {} ({})\n", report.folder, report.layout);
  for (const std::string& note : report.notes) say("         {}\n", note);
  warn_skipped(report);
}

std::string json_file_text(const Json& json) { return json_text(json, 2) + "\n"; }

void print_json(const Json& json) { say("{}", json_file_text(json)); }

Json report_json(const LoadReport& report) {
  Json skipped = Json::array();
  for (const auto& s : report.skipped)
    skipped.push_back({{"count", s.count}, {"why", s.why}, {"examples", s.examples}});
  return {
      {"layout", report.layout}, {"folder", report.folder}, {"notes", report.notes}, {"skipped", skipped}};
}

Json device_json(const DeviceInfo& d) {
  return {{"backend", d.backend},
          {"platform", d.platform},
          {"vendor", d.vendor},
          {"name", d.name},
          {"driver", d.driver},
          {"version", d.version},
          {"type", to_string(d.type)},
          {"memory_bytes", d.memory_bytes},
          {"max_allocation_bytes", d.max_allocation_bytes},
          {"compute_units", d.compute_units},
          {"float_vector_width", d.float_vector_width},
          {"has_double", d.has_double},
          {"pci", d.pci},
          {"tuning", d.tuning}};
}

Json groups_json(const MixedModel& model) {
  Json groups = Json::array();
  for (const SplatModel& group : model.groups)
    groups.push_back({{"dim", group.dim}, {"splats", group.count}});
  return groups;
}

Json quantiles_json(std::vector<double> values) {
  std::ranges::sort(values);
  Json json = Json::object();
  for (const double q : {0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0}) {
    Json& value = json[fmt::format("{:.0f}%", 100 * q)];
    if (!values.empty())
      value = values[static_cast<std::size_t>(std::lround(q * static_cast<double>(values.size() - 1)))];
  }
  return json;
}

Json metrics_json(const Metrics& metrics) {
  Json views = Json::array();
  for (const ViewMetrics& m : metrics.views) views.push_back(view_json(m));
  Json mean = view_json(metrics.mean);
  mean.erase("name");
  Json json{{"mean", std::move(mean)}, {"views", std::move(views)}};
  for (const ViewMetrics& m : metrics.wide_images) json["wide_images"].push_back(view_json(m));
  return json;
}

std::string metrics_text(const ViewMetrics& m) {
  std::string text =
      fmt::format("PSNR {:.3f} dB (joint {:.3f}), SSIM {:.4f}", m.psnr_channel_mean, m.psnr, m.ssim);
  if (m.ssim_valid) text += fmt::format(" (valid {:.4f})", *m.ssim_valid);
  for (const NamedValue& distance : m.lpips)
    text += fmt::format(", {} {:.5f}", distance.name, distance.value);
  if (m.fitted)
    text += fmt::format("; with fitted appearance PSNR {:.3f} dB, SSIM {:.4f}", m.fitted->psnr_channel_mean,
                        m.fitted->ssim);
  if (m.posed)
    text += fmt::format("; with the best-fitting pose PSNR {:.3f} dB, SSIM {:.4f}",
                        m.posed->psnr_channel_mean, m.posed->ssim);
  return text;
}

}  // namespace ubs::tools
