// SPDX-License-Identifier: Apache-2.0
#include "host/experiment/job_folder.hpp"

#include <cmath>

#include "host/base/cache_folder.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/folder_lock.hpp"
#include "host/base/json.hpp"
#include "host/base/paths.hpp"
#include "host/base/warning.hpp"

namespace ubs::experiment {
namespace {

namespace fs = std::filesystem;

Json read_json(const fs::path& path) { return parse_own_json(read_text_file(path), path.string()); }

std::optional<double> number_at(const Json& json, std::initializer_list<const char*> path) {
  const Json* at = &json;
  for (const char* key : path) {
    if (!at->is_object() || !at->contains(key)) return std::nullopt;
    at = &(*at)[key];
  }
  if (!at->is_number() || !std::isfinite(at->get<double>())) return std::nullopt;
  return at->get<double>();
}

void check_finished(const Json& json, const std::string& file) {
  if (json.value("interrupted", true)) fail(ErrorKind::data, "{}: the run was interrupted", file);
  const auto last = number_at(json, {"iterations"}), planned = number_at(json, {"settings", "iterations"});
  if (!last || !planned || *last != *planned)
    fail(ErrorKind::data, "{}: the run did not reach its last iteration", file);
  if (json.contains("test") && json["test"].is_object() && number_at(json, {"test", "iteration"}) != last)
    fail(ErrorKind::data, "{}: the measurement is not that of the last iteration", file);
}

// What an earlier run of the job left goes; a folder that holds anything else, or that was changed, is kept
// under another name.
void clear(const fs::path& folder) {
  if (!path_exists(folder)) return;
  fs::path other;
  for (int i = 1; other.empty() || path_exists(other); ++i)
    other = fs::path(folder).concat(fmt::format(".old-{}", i));
  rename_path(folder, other);
  warn_once(
      fmt::format("{}: holds files that are no results of this program, or that were changed: kept as {}",
                  folder.string(), other.string()));
}

}  // namespace

const char* to_string(JobState state) {
  switch (state) {
    case JobState::done:
      return "done";
    case JobState::missing:
      return "no data";
    case JobState::failed:
      return "failed";
    case JobState::interrupted:
      return "interrupted";
    case JobState::pending:
      return "not run";
  }
  return "?";
}

Json identity_of(const Job& job, const std::vector<std::string>& train_arguments) {
  TrainSettings settings = job.settings;
  const Json all = to_json(bind_fields(settings, train_fields()));
  Json values = Json::object();
  for (const auto& [key, value] : all.items())
    if (decides_result(key)) values[key] = value;
  const fs::path data = job.data.empty() ? fs::path() : resolved_path(job.data);
  return {{"data", data.string()}, {"arguments", train_arguments}, {"settings", std::move(values)}};
}

std::string hash_of(const Json& identity) { return fmt::format("{:016x}", name_hash(json_text(identity))); }

std::map<std::string, double> read_metrics(const fs::path& folder) {
  const fs::path file = folder / "metrics.json";
  const Json json = read_json(file);
  check_finished(json, file.string());
  std::map<std::string, double> values;
  const auto put = [&](const char* key, std::optional<double> value, double factor = 1) {
    if (value) values.try_emplace(key, factor * *value);
  };
  put("psnr", number_at(json, {"test", "mean", "psnr"}));
  put("psnr_joint", number_at(json, {"test", "mean", "psnr_joint"}));
  put("ssim", number_at(json, {"test", "mean", "ssim"}));
  put("lpips", number_at(json, {"test", "mean", "lpips_vgg_unit"}));
  put("minutes", number_at(json, {"seconds"}), 1.0 / 60);
  put("splats", number_at(json, {"splats"}));
  put("iterations", number_at(json, {"iterations"}));
  put("peak_device_mib", number_at(json, {"peak_device_bytes"}), 1.0 / (1 << 20));
  if (path_exists(folder / "eval.json")) {
    const Json eval = read_json(folder / "eval.json");
    put("lpips", number_at(eval, {"mean", "lpips_vgg_unit"}));
    put("fps", number_at(eval, {"frames", "fps_wall"}));
  }
  if (path_exists(folder / "model.ply"))
    values["mib"] = static_cast<double>(file_bytes(folder / "model.ply")) / (1 << 20);
  return values;
}

JobFolder::JobFolder(fs::path runs, const Job& job)
    : final_(runs / job.folder_name()), partial_(runs / (job.folder_name() + ".partial")) {}

std::optional<JobResult> JobFolder::completed(const Json& identity, std::string& why_not) const {
  if (!path_exists(final_)) {
    why_not = path_exists(partial_) ? "an earlier run did not end" : "";
    return std::nullopt;
  }
  try {
    JobResult result{JobState::done, "", read_metrics(final_), read_json(final_ / "job.json")};
    if (result.record.value("identity", Json()) == identity) return result;
    why_not = "settings or data changed";
  } catch (const Error& error) {
    why_not = error.what();
  }
  return std::nullopt;
}

bool JobFolder::begin(const TrainSettings& settings, const Json& identity, bool resume) const {
  {
    const FolderLock lock(partial_);  // its training may live although the program that started it was killed
  }
  TrainSettings copy = settings;
  const std::string text =
      fmt::format("# run {}\n{}", hash_of(identity), to_yaml(bind_fields(copy, train_fields())));
  if (resume && path_exists(partial_ / "checkpoint.ubs") && path_exists(partial_ / kJobSettings) &&
      read_text_file(partial_ / kJobSettings) == text)
    return true;
  clear(partial_);
  make_folders(partial_);
  write_file_atomically(partial_ / kJobSettings, text);
  return false;
}

JobResult JobFolder::commit(const Json& identity, const Json& more) const {
  JobResult result{JobState::done, "", read_metrics(partial_), Json::object()};
  if (!result.values.contains("psnr"))
    result.reason = "the data have no test views with images: not measured";
  const Json metrics = read_json(partial_ / "metrics.json");
  result.record = {{"hash", hash_of(identity)}, {"identity", identity}};
  for (const char* key : {"version", "build", "device", "data_report"})
    if (metrics.contains(key)) result.record[key] = metrics[key];
  result.record.update(more);
  write_file_atomically(partial_ / "job.json", json_text(result.record, 2) + "\n");
  clear(final_);
  rename_path(partial_, final_);
  return result;
}

}  // namespace ubs::experiment
