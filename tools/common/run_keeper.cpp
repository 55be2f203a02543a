// SPDX-License-Identifier: Apache-2.0
#include "tools/common/run_keeper.hpp"

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/base/paths.hpp"
#include "tools/common/job.hpp"
#include "tools/common/output.hpp"

namespace ubs::tools {

namespace fs = std::filesystem;

namespace {

// Returns whether the metrics.json of a run says that the run was interrupted.
bool was_interrupted(const RunFolder& run) {
  try {
    return path_exists(run.metrics()) &&
           parse_own_json(read_text_file(run.metrics()), run.metrics().string()).at("interrupted") == true;
  } catch (const Error&) {            // the file cannot be read
  } catch (const Json::exception&) {  // the file has no such value
  }
  return false;
}

}  // namespace

Checkpoint open_checkpoint(const fs::path& folder, bool more_time) {
  const RunFolder run(folder);
  const fs::path file = path_exists(run.checkpoint()) ? run.checkpoint() : run.continuation();
  if (path_exists(file)) {
    Checkpoint checkpoint = read_checkpoint(file);
    run.check_same_run(checkpoint, file);
    if (file == run.continuation() && checkpoint.is_finished() && !more_time)
      fail(ErrorKind::usage,
           "{}: this run is finished: to continue it, pass additional time, such as --budget +5m",
           folder.string());
    return checkpoint;
  }
  if (was_interrupted(run))
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

RunKeeper::RunKeeper(RunFolder& folder, Checkpoint run, int saved)
    : folder_(folder), run_(std::move(run)), saved_(saved) {}

bool RunKeeper::save(const TrainState& state, const TrainSettings& settings) {
  run_.state = state;
  run_.settings = settings;
  run_.first_row = folder_.first_row();
  try {
    if (folder_.writes())
      // The rows up to here must be on the disk, because a resumed run does not write them again.
      folder_.sync_log();
  } catch (const Error&) {  // a warning was printed when writing the row failed
  }
  try {
    folder_.write_config(settings);
    write_checkpoint(folder_.checkpoint(), run_, ranks());
  } catch (const Error& error) {
    warn("could not write the checkpoint at iteration {}: {}; {}", state.iteration, error.what(),
         saved_ < 0 ? "there is none yet" : fmt::format("the checkpoint of iteration {} remains", saved_));
    return false;
  }
  saved_ = state.iteration;
  return true;
}

}  // namespace ubs::tools
