// SPDX-License-Identifier: Apache-2.0
#include "tools/common/run_keeper.hpp"

#include <cmath>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/base/text.hpp"
#include "host/data/ply.hpp"
#include "tools/common/job.hpp"
#include "tools/common/output.hpp"

namespace ubs::tools {
namespace {

namespace fs = std::filesystem;

// JSON has no NaN: numbers, and as text what is none.
Json numbers(const std::vector<float>& values) {
  Json json = Json::array();
  for (const float v : values) {
    if (std::isfinite(v))
      json.push_back(v);
    else
      json.push_back(fmt::format("{}", v));
  }
  return json;
}

}  // namespace

Checkpoint open_checkpoint(const fs::path& folder) {
  const RunFolder run(folder);
  if (path_exists(run.checkpoint())) return read_checkpoint(run.checkpoint());
  if (path_exists(run.model()))
    fail(ErrorKind::usage,
         "{}: this run is finished (a model and no checkpoint); the schedule scales with --iterations, so "
         "that it cannot be made longer: start a new run",
         folder.string());
  fail(ErrorKind::data, "{}: no checkpoint.ubs in this folder", folder.string());
}

RunKeeper::RunKeeper(RunFolder& folder, Checkpoint run, std::vector<std::string> comments, int saved)
    : folder_(folder), run_(std::move(run)), comments_(std::move(comments)), saved_(saved) {}

bool RunKeeper::save(const TrainState& state, const TrainSettings& settings) {
  run_.state = state;
  run_.settings = settings;
  try {
    if (folder_.writes())
      folder_.sync_log();   // the rows up to here, which a continued run does not make again
  } catch (const Error&) {  // there was a warning when the row could not be written
  }
  try {
    if (run_.budget.seconds > 0 && folder_.writes()) folder_.write_config(settings);
    write_checkpoint(folder_.checkpoint(), run_, ranks());
  } catch (const Error& error) {
    warn("no checkpoint at iteration {}: {}; {}", state.iteration, error.what(),
         saved_ < 0 ? "there is none yet" : fmt::format("the one of iteration {} is kept", saved_));
    return false;
  }
  saved_ = state.iteration;
  return true;
}

void RunKeeper::report(const NonFiniteEvent& event, const std::string& split) {
  if (!folder_.writes()) return;
  std::error_code ignored;
  fs::create_directories(folder_.nonfinite(), ignored);
  const fs::path stem = folder_.nonfinite() / fmt::format("iteration_{}", event.iteration);
  const fs::path model = fs::path(stem).concat(".ply"), report = fs::path(stem).concat(".json");
  const std::string command =
      event.view < 0
          ? ""
          : fmt::format("ubs gradients --model {} --data {} --split {} --view {} --spec {} --out {}",
                        shell_word(model.string()), shell_word(run_.data), split, event.view,
                        shell_word((folder_.model().parent_path() / "config.yaml").string()),
                        shell_word(stem.string() + ".gradient.ply"));
  const Json json{{"iteration", event.iteration},
                  {"stage", event.stage},
                  {"where", event.where},
                  {"view", event.view},
                  {"view_name", event.view_name},
                  {"splat", event.splat},
                  {"parameter", event.parameter},
                  {"parameters", event.model.layout().property_names()},
                  {"raw", numbers(event.raw)},
                  {"gradient", numbers(event.gradient)},
                  {"moment1", numbers(event.moment1)},
                  {"moment2", numbers(event.moment2)},
                  {"splats", event.splats},
                  {"action", event.action},
                  {"replaced_by_zero", event.replaced},
                  {"last_checkpoint", saved_},
                  {"reproduce", command},
                  {"data", run_.data},
                  {"device", run_.device},
                  {"build", run_.build}};
  try {
    write_splat_ply(model, event.model, comments_);
    write_file_atomically(report, json_file_text(json));
    warn("{}; {}; see {}", summary(event), event.action, report.string());
  } catch (const Error& error) {
    warn("{}; {}; its report cannot be written: {}", summary(event), event.action, error.what());
  }
}

}  // namespace ubs::tools
