// SPDX-License-Identifier: Apache-2.0
#include "host/opencl/tuning.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <nlohmann/json.hpp>
#include <set>

#include "host/base/cache_folder.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"

namespace ubs::opencl {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr int kFormat = 1;

std::string environment(const char* name) {
  const char* value = std::getenv(name);
  return value ? value : "";
}

// Devices are listed several times in a process; the same remark is made once.
void warn_once(const std::string& text) {
  static std::mutex mutex;
  static std::set<std::string> said;
  const std::lock_guard lock(mutex);
  if (said.insert(text).second) fmt::print(stderr, "ubs: warning: {}\n", text);
}

const TunedConstant* find_constant(std::string_view macro) {
  const auto& all = tuned_constants();
  const auto found = std::ranges::find(all, macro, &TunedConstant::macro);
  return found == all.end() ? nullptr : &*found;
}

Json identity(const DeviceInfo& device) {
  return {{"device", device.name}, {"driver", device.driver}, {"platform", device.platform}};
}

// Why the file cannot be used; empty: it can.
std::string defect(const Json& json, const DeviceInfo& device) {
  if (!json.is_object()) return "it is no JSON object";
  if (json.value("format", Json()) != Json(kFormat)) return "its format is another";
  const Json expected = identity(device);
  for (const auto& [key, value] : expected.items())
    if (json.value(key, Json()) != value) return fmt::format("it belongs to another {}", key);
  if (!json.contains("values") || !json["values"].is_object()) return "it has no values";
  return "";
}

// Why a value cannot be used; empty: it can.
std::string defect(const std::string& macro, const Json& value) {
  const TunedConstant* constant = find_constant(macro);
  if (!constant) return "there is no such constant";
  if (value.is_number_unsigned() &&
      (value == constant->standard ||
       std::ranges::count(constant->candidates, value.get<std::uint64_t>()) > 0))
    return "";
  return fmt::format("the value {} is not one of its candidates", value.dump());
}

}  // namespace

const std::vector<TunedConstant>& tuned_constants() {
  using enum RasterKind;
  static const std::vector<TunedConstant> all{
      // Whole vectors of 16, at most 64.
      {"UBS_CHUNK", 64, {32, 48}, "opencl/raster_cpu.cl", cpu, {"raster_forward", "raster_backward"}},
      {"UBS_PREFETCH_DISTANCE", 12, {4, 8, 16, 24, 32}, "opencl/raster_cpu.cl", cpu, {"raster_backward"}},
      // Primes, or 1.
      {"UBS_SCATTER", 101, {1, 31, 211}, "opencl/raster_cpu.cl", cpu, {"raster_forward", "raster_backward"}},
      {"UBS_SUM_GROUP", 64, {16, 32, 128, 256}, "opencl/sum_slots.cl", cpu, {"sum_slots"}},
      // Multiples of 16; 26 + 64 rows of the width + 16 floats must fit into local memory.
      {"UBS_LOSS_TILE", 112, {48, 64, 80, 96}, "opencl/loss.cl", cpu, {"image_loss"}},
      {"UBS_LOSS_STRIP", 4, {2, 8}, "opencl/loss.cl", cpu, {"image_loss"}},
      {"UBS_PREFETCH_AHEAD", 1, {2, 4, 8}, "map/project.cl", cpu, {"project_forward", "project_backward"}},
      // Small distances look as good at the tuner's 100K splats and cost most at 3M.
      {"UBS_LISTS_AHEAD", 96, {48, 64, 128}, "opencl/tile_list_chunks.cl", cpu, {"lists"}},
      {"UBS_LISTS_BATCH", 1024, {256, 512, 2048}, "opencl/tile_list_chunks.cl", cpu, {"lists"}},
      {"UBS_PLACES_BATCH", 512, {128, 256, 1024}, "opencl/tile_list_chunks.cl", cpu, {"lists"}},
      // Multiples of 32, at most the 256 work-items of a tile.
      {"UBS_BACKWARD_BATCH", 128, {32, 64, 256}, "opencl/raster_gpu.cl", gpu, {"raster_backward"}},
      // The host says 1 on devices with sub-groups, where 0 may still be faster; elsewhere always 0.
      {"UBS_SUBGROUPS", 0, {0, 1}, "opencl/raster_gpu.cl", gpu, {"raster_backward"}},
      {"UBS_SUM_GROUP_GPU", 64, {32, 128, 256}, "opencl/sum_slots.cl", gpu, {"sum_slots"}},
      {"UBS_LOSS_TILE_GPU", 32, {16, 48, 64}, "opencl/loss.cl", gpu, {"image_loss"}},
      {"UBS_LOSS_GROUP", 128, {64, 256}, "opencl/loss.cl", gpu, {"image_loss"}},
  };
  return all;
}

unsigned tuned_value(const TuningValues& values, std::string_view macro, unsigned fallback) {
  const auto found = values.find(std::string(macro));
  return found == values.end() ? fallback : found->second;
}

unsigned tuned_value(const TuningValues& values, std::string_view macro) {
  const TunedConstant* constant = find_constant(macro);
  if (!constant) fail(ErrorKind::internal, "'{}' is no tuned constant", macro);
  return tuned_value(values, macro, constant->standard);
}

void add_tuning(const TuningValues& values, const std::vector<std::string>& sources,
                std::vector<std::string>& options) {
  for (const TunedConstant& constant : tuned_constants()) {
    const auto value = values.find(std::string(constant.macro));
    if (value == values.end() || std::ranges::count(sources, constant.source) == 0) continue;
    const std::string define = fmt::format("-D{}=", constant.macro);
    if (std::ranges::any_of(options, [&](const std::string& o) { return o.starts_with(define); })) continue;
    options.push_back(define + std::to_string(value->second));
  }
}

fs::path tuning_file(const DeviceInfo& device) {
  const fs::path folder = cache_folder("UBS_TUNING_DIR");
  if (folder.empty()) return {};
  const std::string name = device.name + '\n' + device.driver + '\n' + device.platform;
  return folder / fmt::format("tuning-{:016x}.json", name_hash(name));
}

TuningValues load_tuning(const DeviceInfo& device) {
  TuningValues values;
  const fs::path file = tuning_file(device);
  std::error_code error;
  if (environment("UBS_TUNING") == "off" || file.empty() || !fs::exists(file, error)) return values;
  Json json;
  try {
    json = Json::parse(read_text_file(file), nullptr, false);
  } catch (const Error& failure) {
    warn_once(fmt::format("tuning ignored: {}", failure.what()));
    return values;
  }
  if (const std::string why = defect(json, device); !why.empty()) {
    warn_once(fmt::format("{}: tuning file ignored, {}; 'ubs tune' makes a new one", file.string(), why));
    return values;
  }
  for (const auto& [macro, value] : json["values"].items()) {
    if (const std::string why = defect(macro, value); !why.empty())
      warn_once(fmt::format("{}: '{}' ignored, {}", file.string(), macro, why));
    else
      values[macro] = value.get<unsigned>();
  }
  return values;
}

void save_tuning(const DeviceInfo& device, RasterKind raster, const TuningValues& values) {
  const fs::path file = tuning_file(device);
  if (file.empty())
    fail(ErrorKind::data, "no folder for tuning files: set UBS_TUNING_DIR, XDG_CACHE_HOME or HOME");
  TuningValues all = load_tuning(device);
  std::erase_if(all, [&](const auto& entry) { return find_constant(entry.first)->raster == raster; });
  all.insert(values.begin(), values.end());
  std::error_code error;
  fs::create_directories(file.parent_path(), error);
  if (error) fail(ErrorKind::data, "{}: {}", file.parent_path().string(), error.message());
  Json json = identity(device);
  json["format"] = kFormat;
  json["values"] = Json::object();
  for (const auto& [macro, value] : all) json["values"][macro] = value;
  write_file_atomically(file, json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
}

}  // namespace ubs::opencl
