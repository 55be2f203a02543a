// SPDX-License-Identifier: Apache-2.0
#include "host/device/tuning.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <nlohmann/json.hpp>

#include "host/base/cache_folder.hpp"
#include "host/base/environment.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/base/paths.hpp"
#include "host/base/warning.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

constexpr int kFormat = 1;

const TunedConstant* find_constant(TunedTable table, std::string_view macro) {
  const auto found = std::ranges::find(table, macro, &TunedConstant::macro);
  return found == table.end() ? nullptr : &*found;
}

Json identity(const DeviceInfo& device) {
  return {{"device", device.name}, {"driver", device.driver}, {"platform", device.platform}};
}

// Returns the reason why a tuning file cannot be used for this device, or an empty string if it can be used.
std::string defect(const Json& json, const DeviceInfo& device) {
  if (!json.is_object()) return "it is not a JSON object";
  if (json.value("format", Json()) != Json(kFormat)) return "it has another format version";
  const Json expected = identity(device);
  for (const auto& [key, value] : expected.items())
    if (json.value(key, Json()) != value) return fmt::format("it was written for another {}", key);
  if (!json.contains("values") || !json["values"].is_object()) return "it has no values";
  return "";
}

// Returns the reason why the value of a constant cannot be used, or an empty string if it can be used.
std::string defect(TunedTable table, const std::string& macro, const Json& value) {
  const TunedConstant* constant = find_constant(table, macro);
  if (!constant) return "this constant does not exist";
  if (value.is_number_unsigned() &&
      (value == constant->standard ||
       std::ranges::count(constant->candidates, value.get<std::uint64_t>()) > 0))
    return "";
  return fmt::format("the value {} is not supported", value.dump());
}

}  // namespace

unsigned tuned_value(const TuningValues& values, std::string_view macro, unsigned fallback) {
  const auto found = values.find(std::string(macro));
  return found == values.end() ? fallback : found->second;
}

unsigned tuned_value(TunedTable table, const TuningValues& values, std::string_view macro) {
  const TunedConstant* constant = find_constant(table, macro);
  if (!constant) fail(ErrorKind::internal, "'{}' is not a tuned constant", macro);
  return tuned_value(values, macro, constant->standard);
}

fs::path tuning_file(const DeviceInfo& device) {
  const fs::path folder = cache_folder("UBS_TUNING_DIR");
  if (folder.empty()) return {};
  const std::string name = device.name + '\n' + device.driver + '\n' + device.platform;
  return folder / fmt::format("tuning-{:016x}.json", name_hash(name));
}

namespace {

TuningValues stored_tuning(const DeviceInfo& device, TunedTable table) {
  TuningValues values;
  const fs::path file = tuning_file(device);
  if (file.empty()) return values;
  Json json;
  try {
    if (!path_exists(file)) return values;
    json = parse_own_json(read_text_file(file), file.string());
  } catch (const Error& failure) {
    warn_once(fmt::format("ignoring the tuning file: {}", failure.what()));
    return values;
  }
  if (const std::string why = defect(json, device); !why.empty()) {
    warn_once(fmt::format("{}: ignoring this tuning file: {} ('ubs-lab tune' writes a new one)",
                          file.string(), why));
    return values;
  }
  for (const auto& [macro, value] : json["values"].items()) {
    if (const std::string why = defect(table, macro, value); !why.empty())
      warn_once(fmt::format("{}: ignoring '{}': {}", file.string(), macro, why));
    else
      values[macro] = value.get<unsigned>();
  }
  return values;
}

}  // namespace

TuningValues load_tuning(const DeviceInfo& device, TunedTable table) {
  return environment("UBS_TUNING") == "off" ? TuningValues{} : stored_tuning(device, table);
}

void save_tuning(const DeviceInfo& device, TunedTable table, RasterKind raster, const TuningValues& values) {
  const fs::path file = tuning_file(device);
  if (file.empty())
    fail(ErrorKind::data, "there is no folder for tuning files: set UBS_TUNING_DIR, XDG_CACHE_HOME or HOME");
  TuningValues all = stored_tuning(device, table);  // even if UBS_TUNING is "off"
  std::erase_if(all, [&](const auto& entry) { return find_constant(table, entry.first)->raster == raster; });
  all.insert(values.begin(), values.end());
  make_folders(file.parent_path());
  Json json = identity(device);
  json["format"] = kFormat;
  json["values"] = Json::object();
  for (const auto& [macro, value] : all) json["values"][macro] = value;
  write_file_atomically(file, json_text(json, 2) + "\n");
}

}  // namespace ubs
