// SPDX-License-Identifier: Apache-2.0
#include "tools/train_start.hpp"

#include <unistd.h>

#include <filesystem>

#include "host/base/error.hpp"
#include "host/base/output_place.hpp"
#include "host/base/paths.hpp"
#include "host/run/same_run.hpp"
#include "host/train/budget.hpp"
#include "tools/common/output.hpp"
#include "tools/common/run_keeper.hpp"

namespace ubs::tools {
namespace {

// With --budget the settings start from those of short runs; without a word about iterations they may come
// to.
void resolve_new(const StartOptions& options, const SettingsOptions& given, Start& start) {
  constexpr int kUnsaid = 0;
  const bool asked = !options.budget.empty();
  if (asked) budget_seconds(options.budget);  // refuses what is none, before anything is loaded
  const auto resolved = [&](TrainSettings base) {
    base.dim = kAutoInt;
    base.iterations = kUnsaid;
    return given.resolve(base);
  };
  start.settings = resolved({});
  const bool unsaid = start.settings.iterations == kUnsaid;
  if (asked && !unsaid) fail(ErrorKind::usage, "--budget chooses the iterations: leave out one of the two");
  if (!unsaid) return;
  start.settings.iterations = TrainSettings{}.iterations;
  start.shortened = resolved(short_run_settings());
  start.shortened->iterations = start.settings.iterations;
  if (asked) start.settings = *start.shortened;
}

}  // namespace

std::filesystem::path free_output_folder(const std::filesystem::path& data) {
  namespace fs = std::filesystem;
  fs::path at = absolute_path(data).lexically_normal();
  if (!at.has_filename()) at = at.parent_path();  // a slash at the end
  fs::path folder = at.parent_path();
  const fs::path here = absolute_path("x").lexically_normal().parent_path();
  if (access(folder.c_str(), W_OK | X_OK) != 0) folder = here;
  const std::string name = (is_folder(at) ? at.filename() : at.stem()).string() + "-ubs";
  for (int i = 1;; ++i) {
    const fs::path out = folder / (i == 1 ? name : fmt::format("{}-{}", name, i));
    if (path_exists(out)) continue;
    return folder == here ? out.filename() : out;
  }
}

Start start_of(const StartOptions& options, const SettingsOptions& given, bool holds) {
  if (options.resume.empty()) {
    if (options.data.empty()) fail(ErrorKind::usage, "which data? ubs train FOLDER (see 'ubs train --help')");
    Start start;
    resolve_new(options, given, start);
    if (!path_exists(options.data)) fail(ErrorKind::data, "{}: no such data folder", options.data);
    start.data = options.data;
    start.out = options.out.empty() ? free_output_folder(options.data).string() : options.out;
    check_apart(start.out, {options.data});
    if (holds) start.lock = std::make_unique<FolderLock>(start.out);
    return start;
  }
  if (!options.out.empty() || options.overwrite)
    fail(ErrorKind::usage, "--resume goes on in the folder of the run: leave out --out and --overwrite");
  if (!options.budget.empty())
    fail(ErrorKind::usage, "--resume goes on with the schedule of the run: leave out --budget");
  auto lock = holds && is_folder(options.resume) ? std::make_unique<FolderLock>(options.resume) : nullptr;
  Checkpoint checkpoint = open_checkpoint(options.resume);
  const TrainSettings settings = given.resolve(checkpoint.settings);
  check_same_settings(checkpoint.settings, settings);
  const double end_seconds = checkpoint.end_seconds;
  return {.data = options.data.empty() ? checkpoint.data : options.data,
          .out = options.resume,
          .lock = std::move(lock),
          .settings = settings,
          .checkpoint = std::move(checkpoint),
          .end_seconds = end_seconds};
}

Checkpoint identity(const Start& start, const Split& train, const Device& device) {
  Checkpoint run =
      identity(start.settings, absolute_path(start.data).lexically_normal().string(), train, device);
  if (start.checkpoint) run.planned_seconds = start.checkpoint->planned_seconds;
  return run;
}

}  // namespace ubs::tools
