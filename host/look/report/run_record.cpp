// SPDX-License-Identifier: Apache-2.0
// See run_record.hpp.
#include "host/look/report/run_record.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <sstream>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/base/paths.hpp"
#include "host/dataset/data_root.hpp"
#include "host/settings/fields.hpp"
#include "host/settings/yaml_reader.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> fields_of(std::string line) {
  if (!line.empty() && line.back() == '\r') line.pop_back();
  std::vector<std::string> fields(1);
  for (const char c : line)
    if (c == ',')
      fields.emplace_back();
    else
      fields.back() += c;
  return fields;
}

constexpr std::array<const char*, 8> kColumns{"iteration", "seconds",   "loss",        "splats",
                                              "test_psnr", "test_ssim", "sample_psnr", "sample_views"};
using Row = std::array<Json, kColumns.size()>;  // null: nothing was recorded

// Returns null for an empty field, and nothing for a field that is not a finite number.
std::optional<Json> read_field(const std::string& field) {
  if (field.empty()) return Json();
  char* end = nullptr;
  const double number = std::strtod(field.c_str(), &end);
  if (end != field.c_str() + field.size() || !std::isfinite(number)) return {};
  return number;
}

std::optional<Row> read_row(const std::vector<std::string>& head, const std::vector<std::string>& fields) {
  if (fields.size() != head.size()) return {};
  Row row;
  for (std::size_t c = 0; c < kColumns.size(); ++c) {
    const auto at = std::find(head.begin(), head.end(), kColumns[c]);
    if (at == head.end()) continue;
    const std::optional<Json> value = read_field(fields[static_cast<std::size_t>(at - head.begin())]);
    if (!value) return {};
    row[c] = *value;
  }
  return row[0].is_null() ? std::nullopt : std::optional(row);
}

void take_setting(RunRecord& run, FieldValues fields, const std::string& key, const std::string& value,
                  std::vector<std::string>& unknown) {
  // If this version of ubs knows the setting, `shown` becomes the text that it writes for the value, so that
  // equal values have equal texts.
  std::string shown = value;
  try {
    shown = set_field_from_run(fields, key, value, "setting");
  } catch (const Error&) {
    unknown.push_back(key);
  }
  run.setting_texts.emplace_back(key, shown);
}

std::string setting_text(const Json& value) {
  if (value.is_string()) return value.get<std::string>();
  if (!value.is_array()) return value.dump();
  std::string out;
  for (const Json& item : value) out.append(out.empty() ? "" : ",").append(setting_text(item));
  return out;
}

void read_settings(RunRecord& run) {
  const std::vector<FieldValue> fields = bind_fields(run.settings, train_fields());
  std::vector<std::string> unknown;
  if (const fs::path path = run.folder / "config.yaml"; path_exists(path)) {
    const YamlReader reader(path);
    for (const YamlEntry& entry : reader.entries(reader.root(), "the file"))
      take_setting(run, fields, entry.key, reader.text(entry), unknown);
  } else if (const Json* settings = run.find({"settings"}); settings && settings->is_object()) {
    run.remarks.push_back("config.yaml is missing: the settings are taken from metrics.json");
    for (const auto& [key, value] : settings->items())
      take_setting(run, fields, key, setting_text(value), unknown);
  } else {
    run.remarks.push_back("the settings are unknown: config.yaml is missing");
  }
  if (!unknown.empty())
    run.remarks.push_back(
        fmt::format("settings that are unknown to this version: {}", fmt::join(unknown, ", ")));
}

void read_metrics(RunRecord& run) {
  const fs::path path = run.folder / "metrics.json";
  if (!path_exists(path)) {
    run.remarks.push_back("metrics.json is missing: the run was not finished");
    return;
  }
  try {
    run.metrics = parse_own_json(read_text_file(path), path.string());
    if (!run.metrics.is_object()) fail(ErrorKind::data, "{}: must contain a JSON object", path.string());
  } catch (const Error& error) {
    fail(ErrorKind::data,
         "{}; to do without this file, delete it, and pass the data folder to commands that need the data",
         error.what());
  }
}

std::string folder_name(const fs::path& folder) {
  const fs::path whole = fs::absolute(folder).lexically_normal();
  return (whole.has_filename() ? whole : whole.parent_path()).filename().string();
}

}  // namespace

const Json* RunRecord::find(const std::vector<std::string>& path) const {
  const Json* at = &metrics;
  for (const std::string& key : path) {
    if (!at->is_object() || !at->contains(key)) return nullptr;
    at = &(*at)[key];
  }
  return at;
}

std::optional<double> RunRecord::number(const std::vector<std::string>& path) const {
  const Json* found = find(path);
  if (!found || !found->is_number()) return {};
  return found->get<double>();
}

std::optional<std::uint32_t> RunRecord::data_print() const {
  const Json* found = find({"data_print"});
  if (!found || !found->is_number_unsigned()) return {};
  const auto print = found->get<std::uint64_t>();
  return print <= UINT32_MAX ? std::optional(static_cast<std::uint32_t>(print)) : std::nullopt;
}

std::string RunRecord::text(const std::vector<std::string>& path) const {
  const Json* found = find(path);
  return found && found->is_string() ? found->get<std::string>() : "";
}

Json parse_log(const std::string& csv, const std::string& origin, std::vector<std::string>& remarks) {
  std::istringstream stream(csv);
  std::string line;
  std::getline(stream, line);
  const std::vector<std::string> head = fields_of(line);
  Json log = Json::object();
  if (std::find(head.begin(), head.end(), "iteration") == head.end()) {
    remarks.push_back(origin + " has no column 'iteration', so the report has no curves");
    return log;
  }
  std::vector<Row> rows;
  std::size_t bad = 0;
  while (std::getline(stream, line)) {
    const std::optional<Row> row = read_row(head, fields_of(line));
    if (!row) {
      ++bad;
      continue;
    }
    // After a rollback (--on-nan rollback), the log contains some iterations twice. Keep the later rows.
    while (!rows.empty() && rows.back()[0] >= (*row)[0]) rows.pop_back();
    rows.push_back(*row);
  }
  if (bad > 0) remarks.push_back(fmt::format("{}: {} rows could not be read and are ignored", origin, bad));
  for (const Row& row : rows)
    for (std::size_t c = 0; c < kColumns.size(); ++c) log[kColumns[c]].push_back(row[c]);
  return log;
}

std::string data_from_run(const fs::path& data, const fs::path& run) {
  return resolved_path(data).lexically_relative(resolved_path(run)).string();
}

std::vector<fs::path> data_places(const std::string& data, const std::string& from_run, const fs::path& run) {
  std::vector<fs::path> places;
  const fs::path whole = resolved_path(run);
  const bool absolute = fs::path(data).is_absolute();
  if (absolute) places.emplace_back(data);
  if (!from_run.empty() && fs::path(from_run).is_relative())
    places.push_back((whole / from_run).lexically_normal());
  if (!data.empty() && !absolute) places.insert(places.end(), {data, whole.parent_path() / data});
  return places;
}

RunRecord read_run(const fs::path& folder, bool allow_outside) {
  if (!path_exists(folder)) fail(ErrorKind::data, "{}: no such folder", folder.string());
  if (!is_folder(folder))
    fail(ErrorKind::data, "{}: not a folder: pass the output folder of 'ubs train'", folder.string());
  RunRecord run;
  run.folder = folder;
  run.name = folder_name(folder);
  const char* files[] = {"model.ply", "metrics.json", "log.csv", "checkpoint.ubs"};
  if (std::none_of(std::begin(files), std::end(files),
                   [&](const char* file) { return path_exists(folder / file); }))
    fail(ErrorKind::data, "{}: not an output folder of 'ubs train': it contains none of {}", folder.string(),
         fmt::join(files, ", "));
  const DataRoot root(folder, allow_outside);
  for (const char* file : files) root.check(folder / file);
  for (const char* file : {"config.yaml", "cameras/transforms.json", "renders"}) root.check(folder / file);
  if (is_folder(run.renders()))
    for (const fs::path& file : folder_entries(run.renders())) root.check(file);
  read_metrics(run);
  read_settings(run);
  if (run.settings.refine_cameras != RefineCameras::none && path_exists(folder / "cameras"))
    run.settings.run_cameras = (folder / "cameras").string();
  if (const fs::path log = folder / "log.csv"; path_exists(log))
    run.log = parse_log(read_text_file(log), "log.csv", run.remarks);
  else
    run.remarks.push_back("log.csv is missing, so the report has no curves");
  return run;
}

}  // namespace ubs
