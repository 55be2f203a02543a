// SPDX-License-Identifier: Apache-2.0
// Settings and device on the page of `ubs report`: what is not the default, and where runs differ.
#include <fmt/format.h>

#include <algorithm>

#include "host/base/json.hpp"
#include "host/report/report_sections.hpp"
#include "host/spec/settings.hpp"

namespace ubs {
namespace {

std::string setting_of(const RunRecord& run, const std::string& key) {
  for (const auto& [name, value] : run.setting_texts)
    if (name == key) return value;
  return kNothing;
}

std::vector<std::pair<std::string, std::string>> default_texts() {
  TrainSettings defaults;
  std::vector<std::pair<std::string, std::string>> out;
  for (const FieldValue& field : bind_fields(defaults, train_fields()))
    out.emplace_back(field.key, field_text(field));
  return out;
}

// What the program chose by the data is nobody's setting.
bool chosen_by_data(const RunRecord& run, const std::string& key) {
  const Json* chosen = run.find({"chosen"});
  return chosen && chosen->is_array() && std::find(chosen->begin(), chosen->end(), key) != chosen->end();
}

TableCell setting_cell(const std::string& value) {
  return {tag("code", text(value.empty() ? "\"\"" : value))};
}

}  // namespace

Section settings_section(const ReportRuns& runs) {
  const auto defaults = default_texts();
  std::vector<std::string> keys;
  for (const ReportRun& run : runs)
    for (const auto& [key, value] : run.record.setting_texts)
      if (std::find(keys.begin(), keys.end(), key) == keys.end()) keys.push_back(key);
  if (keys.empty()) return {"settings", "Settings", {}};
  std::vector<TableRow> chosen, others;
  std::vector<std::string> chosen_styles;
  for (const std::string& key : keys) {
    const auto known =
        std::find_if(defaults.begin(), defaults.end(), [&](const auto& d) { return d.first == key; });
    TableRow row{{tag("code", text(key))}};
    bool differ = false, changed = known == defaults.end();
    for (const ReportRun& run : runs) {
      const std::string value = setting_of(run.record, key);
      differ = differ || value != setting_of(runs[0].record, key);
      changed = changed || (value != known->second && !chosen_by_data(run.record, key));
      row.push_back(setting_cell(value));
    }
    row.push_back(known == defaults.end() ? plain("unknown to this version") : setting_cell(known->second));
    if (differ || changed) chosen_styles.push_back(differ ? "differ" : "");
    (differ || changed ? chosen : others).push_back(std::move(row));
  }
  TableRow head = head_row(runs, "setting");
  head.push_back(plain("default"));
  Html out = paragraph(
      "note", text(runs.size() > 1 ? "Settings that are not the default; marked where the runs differ."
                                   : "Settings that are not the default."));
  out += table(head, chosen, chosen_styles);
  return {"settings", "Settings",
          out + tag("details",
                    tag("summary", text(fmt::format("Settings at their default ({})", others.size()))) +
                        table(head, others))};
}

Section device_section(const ReportRuns& runs) {
  std::vector<std::string> keys;
  for (const ReportRun& run : runs)
    if (const Json* device = run.record.find({"device"}); device && device->is_object())
      for (const auto& [key, value] : device->items())
        if (std::find(keys.begin(), keys.end(), key) == keys.end()) keys.push_back(key);
  std::vector<TableRow> rows;
  std::vector<std::string> styles;
  for (const std::string& key : keys) {
    rows.push_back(text_row(runs, key.c_str(), {"device", key}));
    const auto* first = runs[0].record.find({"device", key});
    const bool differ = std::any_of(runs.begin(), runs.end(), [&](const ReportRun& run) {
      const Json* other = run.record.find({"device", key});
      return !first || !other ? first != other : *first != *other;
    });
    styles.push_back(differ ? "differ" : "");
  }
  TableRow drawn{plain("pictures of this page")};
  for (const ReportRun& run : runs) drawn.push_back(plain(run.drawn_on.empty() ? kNothing : run.drawn_on));
  rows.push_back(std::move(drawn));
  styles.emplace_back();
  return {"device", "Device", table(head_row(runs, "of training"), rows, styles)};
}

}  // namespace ubs
