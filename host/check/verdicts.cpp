// SPDX-License-Identifier: Apache-2.0
#include "host/check/verdicts.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "host/base/cache_folder.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"

namespace ubs::check {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kBuilds = 8;  // maximum number of builds whose verdicts are stored
constexpr Part kParts[] = {Part::drawing, Part::loss, Part::gradients, Part::learning, Part::networks};

// Returns a string with the properties of the device that its results may depend on.
std::string device_text(const DeviceInfo& d) {
  std::string text;
  for (const std::string& part : {d.backend, d.platform, d.vendor, d.name, d.driver, d.version, d.pci})
    text += part + '\n';
  for (const auto& [macro, value] : d.tuning) text += fmt::format("{}={}\n", macro, value);
  return text;
}

// If UBS_KERNEL_DIR is set, kernel sources in this folder are used instead of the embedded ones. Then this
// function returns a string with a hash of these sources. Otherwise it returns an empty string.
std::string sources_text() {
  const char* folder = std::getenv("UBS_KERNEL_DIR");
  if (!folder || !*folder) return "";
  std::vector<fs::path> files;
  std::error_code error;
  for (fs::recursive_directory_iterator at(folder, error), end; !error && at != end; at.increment(error))
    if (at->is_regular_file(error)) files.push_back(at->path());
  std::ranges::sort(files);
  std::uint64_t hash = name_hash(folder);
  for (const fs::path& file : files) hash = name_hash(read_text_file(file), name_hash(file.string(), hash));
  return fmt::format(" sources {:016x}", hash);
}

Json to_json(const Verdict& v) {
  Json json{{"form", v.form}, {"parts", Json::array()}, {"right", v.right}};
  for (const Part part : v.parts) json["parts"].push_back(to_string(part));
  if (!v.right) json["problem"] = v.problem;
  return json;
}

Verdict from_json(const Json& json) {
  Verdict v{json.at("form"), {}, json.at("right"), json.value("problem", "")};
  for (const Json& name : json.at("parts"))
    for (const Part part : kParts)
      if (name == to_string(part)) v.parts.push_back(part);
  return v;
}

// Returns the verdicts of each build, oldest build first. Returns no verdicts if the file is missing or
// damaged, or belongs to another device.
Json read_builds(const std::string& file, const std::string& device) {
  std::error_code error;
  if (file.empty() || !fs::exists(file, error)) return Json::object();
  try {
    const Json json = parse_json(read_text_file(file), file);
    if (json.at("device") == device && json.at("builds").is_object()) return json["builds"];
  } catch (const std::exception&) {  // a damaged file will be replaced
  }
  return Json::object();
}

bool contains(const Parts& parts, const Parts& wanted) {
  return std::ranges::all_of(wanted, [&](Part part) { return std::ranges::count(parts, part) > 0; });
}

}  // namespace

Verdicts::Verdicts(const DeviceInfo& device, const std::string& build)
    : device_(device_text(device)), build_(build + sources_text()) {
  const fs::path folder = kernel_cache_folder();
  if (folder.empty()) return;
  file_ = folder / fmt::format("check-{:016x}.json", name_hash(device_));
  const Json builds = read_builds(file_, device_);
  if (!builds.contains(build_)) return;
  try {
    for (const Json& json : builds[build_]) verdicts_.push_back(from_json(json));
  } catch (const Json::exception&) {
    verdicts_.clear();
  }
}

std::optional<Verdict> Verdicts::find(const std::string& form, const Parts& parts) const {
  for (const Verdict& v : verdicts_)
    if (v.form == form && contains(v.parts, parts)) return v;
  return std::nullopt;
}

void Verdicts::keep(Verdict verdict) {
  std::erase_if(verdicts_,
                [&](const Verdict& v) { return v.form == verdict.form && contains(verdict.parts, v.parts); });
  verdicts_.push_back(std::move(verdict));
  write();
}

void Verdicts::forget() {
  verdicts_.clear();
  write();
}

void Verdicts::write() const {
  if (file_.empty()) return;
  Json builds = read_builds(file_, device_);
  builds.erase(build_);
  while (builds.size() >= kBuilds) builds.erase(builds.begin());
  Json& own = builds[build_] = Json::array();
  for (const Verdict& v : verdicts_) own.push_back(to_json(v));
  const Json json{{"device", device_}, {"builds", std::move(builds)}};
  try {
    write_file_atomically(file_, json.dump(1, ' ', false, Json::error_handler_t::replace) + "\n",
                          FileUse::cache);
  } catch (const std::exception&) {  // a verdict that is not stored will be determined again
  }
}

}  // namespace ubs::check
