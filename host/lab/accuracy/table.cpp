// SPDX-License-Identifier: Apache-2.0
#include "host/lab/accuracy/table.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "host/base/json.hpp"
#include "host/base/text.hpp"

namespace ubs::accuracy {
namespace {

constexpr const char* kStages[] = {
    "forward",    "iteration",       "project_forward", "lists + raster_forward",
    "image_loss", "raster_backward", "project_backward"};

std::string cell(const std::string& stage, const std::string& text) {
  return fmt::format(" {:>{}}", text, std::max<std::size_t>(stage.size(), 16));
}

std::string csv_field(const std::string& bytes) {
  const std::string text = encode_text(bytes);
  if (text.find_first_of(",\"") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return quoted + '"';
}

std::string table_line(const std::string& form, const std::string& dim, const std::string& scene) {
  return fmt::format("{:<32} {:>2} {:<10}", form, dim, scene);
}

}  // namespace

std::string table_header() {
  std::string text = table_line("form", "N", "scene");
  for (const std::string stage : kStages) text += cell(stage, stage);
  return text + "  device";
}

std::string table_row(const Result& r) {
  const bool same = r.truth == "same";
  std::string text = table_line(same ? r.form : fmt::format("{} (against {})", r.form, r.truth),
                                std::to_string(r.dim), r.scene);
  if (!r.note.empty()) return text + " " + r.note;
  for (const std::string stage : kStages) {
    const auto found = std::ranges::find(r.stages, stage, &TimedErrors::stage);
    const bool measured = found != r.stages.end();
    text += cell(stage, measured ? fmt::format("{:.1e} {:>8.3f}",
                                               check::worst(found->quantities).errors.typical, found->ms)
                                 : "-");
  }
  return text + "  " + r.device;
}

std::string table_csv(std::span<const Result> results) {
  std::string text =
      "form,truth,N,scene,device,stage,quantity,relative_error,typical_error,max_error,median_ms\n";
  for (const Result& r : results)
    for (const TimedErrors& s : r.stages)
      for (const check::NamedErrors& e : s.quantities)
        text += fmt::format("{},{},{},{},{},{},{},{:.6g},{:.6g},{:.6g},{:.6g}\n", csv_field(r.form),
                            csv_field(r.truth), r.dim, csv_field(r.scene), csv_field(r.device), s.stage,
                            e.quantity, e.errors.relative, e.errors.typical, e.errors.absolute, s.ms);
  return text;
}

Json table_json(std::span<const Result> results) {
  Json all = Json::array();
  for (const Result& r : results) {
    Json json{{"form", r.form}, {"truth", r.truth}, {"dim", r.dim}, {"scene", r.scene}, {"device", r.device}};
    if (!r.note.empty())
      json["note"] = r.note;
    else
      json["contributions_per_pixel"] = r.contributions;
    for (const TimedErrors& s : r.stages) {
      Json& stage = json["stages"][s.stage] = {{"median_ms", s.ms}};
      for (const check::NamedErrors& e : s.quantities)
        stage["errors"][e.quantity] = {
            {"relative", e.errors.relative}, {"typical", e.errors.typical}, {"max", e.errors.absolute}};
    }
    all.push_back(std::move(json));
  }
  return all;
}

}  // namespace ubs::accuracy
