// SPDX-License-Identifier: Apache-2.0
#include "tools/common/run_writer.hpp"

#include <algorithm>
#include <optional>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/base/paths.hpp"
#include "host/base/warning.hpp"
#include "host/look/report/run_record.hpp"
#include "tools/common/job.hpp"
#include "tools/common/output.hpp"

namespace ubs::tools {

namespace fs = std::filesystem;

namespace {

// Returns the content of the metrics.json of a run; null if it cannot be read.
Json metrics_of(const RunFolder& run) {
  try {
    if (path_exists(run.metrics()))
      return parse_own_json(read_text_file(run.metrics()), run.metrics().string());
  } catch (const std::exception&) {
  }
  return {};
}

bool was_interrupted(const Json& metrics) {
  return metrics.is_object() && metrics.value("interrupted", Json()) == true;
}

// Throws Error(usage) if the results in the folder are of a later iteration than the checkpoint, because the
// run would replace them by older ones. Results of a cool-down after Ctrl-C are the exception: such a run
// continues from the state before the cool-down.
void check_newest(const Json& metrics, const Checkpoint& checkpoint, const fs::path& file) {
  if (!metrics.is_object()) return;
  const auto iteration_in = [](const Json& json, const char* key) {
    const Json value = json.is_object() ? json.value(key, Json()) : Json();
    return value.is_number_integer() ? value.get<int>() : -1;
  };
  const int early = iteration_in(metrics.value("ended_early", Json()), "iteration");
  const int results = early >= 0 ? early : iteration_in(metrics, "iterations");
  if (checkpoint.state.iteration < results)
    fail(ErrorKind::usage,
         "{}: this checkpoint is of iteration {}, but the model in this folder is of iteration {}: to resume "
         "from the checkpoint, move model.ply and metrics.json to another folder",
         file.string(), checkpoint.state.iteration, results);
}

}  // namespace

Checkpoint open_checkpoint(const fs::path& folder, bool more_time) {
  const RunFolder run(folder);
  const Json metrics = metrics_of(run);
  const fs::path file = path_exists(run.checkpoint()) ? run.checkpoint() : run.continuation();
  if (path_exists(file)) {
    Checkpoint checkpoint = read_checkpoint(file);
    run.check_same_run(checkpoint, file);
    check_newest(metrics, checkpoint, file);
    const auto places = data_places(checkpoint.data, checkpoint.data_from_run, folder);
    if (const auto found = std::ranges::find_if(places, path_exists); found != places.end())
      checkpoint.data = found->string();
    if (file == run.continuation() && checkpoint.is_finished() && !more_time)
      fail(ErrorKind::usage,
           "{}: this run is finished: to continue it, pass additional time, such as --budget +5m",
           folder.string());
    return checkpoint;
  }
  if (was_interrupted(metrics))
    fail(ErrorKind::data,
         "{}: this run was interrupted, but its checkpoint.ubs is missing, so it cannot be continued: copy "
         "this file back, or start a new run",
         folder.string());
  if (path_exists(run.model()))
    fail(ErrorKind::usage,
         "{}: this run is finished, and it has no continue.ubs from which it could be continued: start a new "
         "run",
         folder.string());
  fail(ErrorKind::data, "{}: no checkpoint.ubs in this folder", folder.string());
}

RunWriter::RunWriter(RunFolder& folder, Checkpoint run, int saved)
    : folder_(folder), run_(std::move(run)), saved_(saved) {
  run_.data_from_run = data_from_run(run_.data, folder_.path());
}

bool RunWriter::save(const TrainState& state, const TrainSettings& settings) {
  return save(state.iteration, settings, [&] { run_.state = state; });
}

bool RunWriter::save(const Trainer& trainer, const TrainSettings& settings) {
  if (ranks().size() > 1) return save(trainer.state(), settings);  // other ranks wait if this one fails
  return save(trainer.iteration(), settings, [&] { run_.state = trainer.state(); });
}

bool RunWriter::save(int iteration, const TrainSettings& settings, const std::function<void()>& take_state) {
  try {
    folder_.check_place();
  } catch (const Error&) {
    saved_ = -1;  // the checkpoints so far are lost too
    throw;
  }
  const auto failed = [&](const std::exception& exception) {
    warn("could not write the checkpoint at iteration {}: {}; {}", iteration, as_error(exception).what(),
         saved_ < 0 ? "there is none yet" : fmt::format("the checkpoint of iteration {} remains", saved_));
    return false;
  };
  std::optional<Error> problem;
  try {
    take_state();
    run_.settings = settings;
    run_.first_row = folder_.first_row();
    try {
      // The rows up to here must be on the disk, because a resumed run does not write them again.
      folder_.sync_log();
    } catch (const std::exception&) {  // a warning was printed when writing the row failed
    }
    folder_.write_config(settings);
  } catch (const std::exception& exception) {
    problem = as_error(exception);
  }
  // All ranks must write the checkpoint, or none.
  if (on_any_rank(problem.has_value()))
    return failed(problem.value_or(Error(ErrorKind::data, "another rank could not write")));
  try {
    write_checkpoint(folder_.checkpoint(), run_, ranks());
  } catch (const std::exception& exception) {
    return failed(exception);
  }
  saved_ = iteration;
  return true;
}

void RunWriter::finish(int iteration) {
  if (saved_ < 0) return;
  if (saved_ == iteration) return folder_.keep_checkpoint();
  warn(
      "the run cannot be continued with more time: its last checkpoint, of iteration {}, is older than the "
      "results, and was removed",
      saved_);
  folder_.remove_older_states();
}

}  // namespace ubs::tools
